//! A connection that is opened again when it breaks.

use std::{
    io,
    time::{Duration, Instant},
};

use crate::{address::Address, event::LinkEvent, transport::Transport};

/// How long to wait before an address that failed is tried again.
const RETRY: Duration = Duration::from_secs(1);

/// An address, and its connection while there is one.
#[derive(Debug)]
pub(crate) struct Reopened {
    address: Address,
    transport: Option<Transport>,
    retry_at: Instant,
    /// Why the address could not be opened the last time, so that it is said once.
    failure: Option<String>,
}

impl Reopened {
    pub fn new(address: Address) -> Self {
        Self {
            address,
            transport: None,
            retry_at: Instant::now(),
            failure: None,
        }
    }

    /// Why the address cannot be opened.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// Reads what is there, waiting for it up to `wait`. `None` if the address is not open.
    pub fn receive(
        &mut self,
        buffer: &mut [u8],
        wait: Duration,
        events: &mut Vec<LinkEvent>,
    ) -> Option<usize> {
        match self.open(events)?.receive(buffer, wait) {
            Ok(length) => Some(length),
            Err(error) => {
                self.lose(&error, events);
                None
            }
        }
    }

    /// Sends bytes, if the address is open. Says whether they left.
    pub fn send(&mut self, bytes: &[u8], events: &mut Vec<LinkEvent>) -> bool {
        let Some(transport) = self.open(events) else {
            return false;
        };
        match transport.send(bytes) {
            Ok(()) => true,
            Err(error) => {
                self.lose(&error, events);
                false
            }
        }
    }

    /// As [`Transport::forget_peer`].
    pub fn forget_peer(&mut self) {
        if let Some(transport) = &mut self.transport {
            transport.forget_peer();
        }
    }

    /// Opens the address if it is not open and it is time to try, though there is nothing to read or to send.
    pub fn keep_open(&mut self, events: &mut Vec<LinkEvent>) {
        self.open(events);
    }

    fn open(&mut self, events: &mut Vec<LinkEvent>) -> Option<&mut Transport> {
        if self.transport.is_none() && Instant::now() >= self.retry_at {
            self.retry_at = Instant::now() + RETRY;
            match Transport::open(&self.address) {
                Ok(transport) => {
                    self.transport = Some(transport);
                    self.failure = None;
                    events.push(LinkEvent::Opened(self.address.clone()));
                }
                Err(error) => {
                    let reason = error.to_string();
                    if self.failure.as_ref() != Some(&reason) {
                        events.push(LinkEvent::CannotOpen {
                            address: self.address.clone(),
                            reason: reason.clone(),
                        });
                        self.failure = Some(reason);
                    }
                }
            }
        }
        self.transport.as_mut()
    }

    fn lose(&mut self, error: &io::Error, events: &mut Vec<LinkEvent>) {
        self.transport = None;
        self.retry_at = Instant::now() + RETRY;
        events.push(LinkEvent::Lost {
            address: self.address.clone(),
            reason: error.to_string(),
        });
    }
}
