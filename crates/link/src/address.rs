//! Where a connection goes: `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT`, `serial:PATH:BAUD`.

use std::{fmt, path::PathBuf, str::FromStr};

/// Where an autopilot, or a receiver of NMEA sentences, is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Address {
    /// Waits for datagrams on this address and answers whoever sends them.
    UdpIn {
        /// Name or IP address of the interface; `0.0.0.0` for all.
        host: String,
        /// UDP port.
        port: u16,
    },
    /// Sends datagrams to this address.
    UdpOut {
        /// Name or IP address.
        host: String,
        /// UDP port.
        port: u16,
    },
    /// Connects as a client.
    Tcp {
        /// Name or IP address.
        host: String,
        /// TCP port.
        port: u16,
    },
    /// A serial port, 8 data bits, no parity, 1 stop bit.
    Serial {
        /// Device, such as `/dev/ttyACM0` or `COM3`.
        path: PathBuf,
        /// Baud.
        baud: u32,
    },
}

/// Why a text is no address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is not an address; expected udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PATH:BAUD, \
     such as udpin:0.0.0.0:14550 or serial:/dev/ttyACM0:921600"
)]
pub struct AddressError(pub String);

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let wrong = || AddressError(text.to_owned());
        let (kind, rest) = text.split_once(':').ok_or_else(wrong)?;
        let (place, number) = rest.rsplit_once(':').ok_or_else(wrong)?;
        if place.is_empty() {
            return Err(wrong());
        }
        if kind == "serial" {
            return match number.parse() {
                Ok(baud) if baud > 0 => Ok(Self::Serial {
                    path: place.into(),
                    baud,
                }),
                _ => Err(wrong()),
            };
        }
        let host = match place.strip_prefix('[') {
            Some(rest) => rest.strip_suffix(']').ok_or_else(wrong)?,
            None => place,
        }
        .to_owned();
        // As in `tcp://HOST:PORT`.
        if host.starts_with('/') {
            return Err(wrong());
        }
        let port = number.parse().map_err(|_| wrong())?;
        match kind {
            "udpin" => Ok(Self::UdpIn { host, port }),
            "udpout" if port > 0 => Ok(Self::UdpOut { host, port }),
            "tcp" if port > 0 => Ok(Self::Tcp { host, port }),
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, host, port) = match self {
            Self::Serial { path, baud } => return write!(f, "serial:{}:{baud}", path.display()),
            Self::UdpIn { host, port } => ("udpin", host, port),
            Self::UdpOut { host, port } => ("udpout", host, port),
            Self::Tcp { host, port } => ("tcp", host, port),
        };
        if host.contains(':') {
            write!(f, "{kind}:[{host}]:{port}")
        } else {
            write!(f, "{kind}:{host}:{port}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_written_the_same() {
        for text in [
            "udpin:0.0.0.0:14550",
            "udpout:192.168.1.2:14550",
            "tcp:localhost:5760",
            "tcp:[::1]:5760",
            "serial:/dev/ttyACM0:921600",
            "serial:/dev/serial/by-id/usb-x:y:115200",
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn what_is_no_address_is_refused() {
        for text in [
            "",
            "udpin",
            "udpin:14550",
            "udpin::14550",
            "udpout:host:0",
            "udp:host:14550",
            "tcp:host:70000",
            "tcp://host:5760",
            "tcp:[::1:5760",
            "serial:/dev/ttyACM0",
            "serial:/dev/ttyACM0:0",
        ] {
            let error = text.parse::<Address>().unwrap_err();
            assert!(error.to_string().contains("udpin:HOST:PORT"), "{text}");
        }
    }
}
