//! MAVLink messages over an address that may come and go.

use std::{
    collections::VecDeque,
    io::{self, Read},
    time::Duration,
};

use mavlink::{
    MavHeader, MavlinkReader, SigningData, dialects::common::MavMessage, error::MessageReadError,
    write_v2_msg_signed,
};

use crate::{address::Address, event::LinkEvent, reopened::Reopened, signing::SigningKey};

/// The component that a companion computer with a position from a camera is.
pub(crate) const OWN_COMPONENT: u8 =
    mavlink::dialects::common::MavComponent::MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY as u8;

/// Messages to and from an address. It opens the address, and opens it again when the connection breaks.
pub(crate) struct Connection {
    bytes: Reopened,
    reader: MavlinkReader<Inbox>,
    signing: Option<SigningData>,
    sequence: u8,
    /// Whether anything came the last time that it was waited for.
    has_received: bool,
}

/// Bytes that were received and not read yet.
#[derive(Debug, Default)]
struct Inbox(VecDeque<u8>);

impl Read for Inbox {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer)? {
            0 => Err(io::ErrorKind::WouldBlock.into()),
            length => Ok(length),
        }
    }
}

impl Connection {
    pub fn new(address: Address, key: Option<&SigningKey>) -> Self {
        Self {
            bytes: Reopened::new(address),
            reader: MavlinkReader::new(Inbox::default()),
            signing: key.map(|key| SigningData::from_config(key.config())),
            sequence: 0,
            has_received: false,
        }
    }

    /// Why the address cannot be opened.
    pub fn failure(&self) -> Option<&str> {
        self.bytes.failure()
    }

    /// Waits up to `wait` for messages.
    pub fn receive(
        &mut self,
        wait: Duration,
        events: &mut Vec<LinkEvent>,
    ) -> Vec<(MavHeader, MavMessage)> {
        let mut buffer = [0; 2048];
        let received = self.bytes.receive(&mut buffer, wait, events);
        self.has_received = received.is_some_and(|length| length > 0);
        match received {
            Some(length) => self.reader.get_mut().0.extend(&buffer[..length]),
            None => std::thread::sleep(wait),
        }
        let mut messages = Vec::new();
        loop {
            match self.reader.read_any_message_signed(self.signing.as_ref()) {
                Ok(message) => messages.push(message),
                // A message of another dialect, or one with a value that is not known.
                Err(MessageReadError::Parse(_)) => {}
                Err(MessageReadError::Io(_)) => return messages,
            }
        }
    }

    /// Whether anything came the last time that it was waited for: messages, or bytes that hold none that can be read.
    pub fn has_received(&self) -> bool {
        self.has_received
    }

    /// Says that who was heard is not the autopilot: of several senders to one UDP port the first one would be the only one heard.
    pub fn forget_peer(&mut self) {
        self.bytes.forget_peer();
    }

    /// Sends a message in the name of `system_id`.
    pub fn send(&mut self, system_id: u8, message: &MavMessage, events: &mut Vec<LinkEvent>) {
        let header = MavHeader {
            system_id: system_id.into(),
            component_id: OWN_COMPONENT,
            sequence: self.sequence,
        };
        let mut bytes = Vec::with_capacity(300);
        // Writing to memory cannot fail.
        let written = write_v2_msg_signed(&mut bytes, header, message, self.signing.as_ref());
        if written.is_ok() && self.bytes.send(&bytes, events) {
            self.sequence = self.sequence.wrapping_add(1);
        }
    }
}
