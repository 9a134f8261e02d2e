//! Bytes to and from an address.

use std::{
    io::{self, ErrorKind, Read as _, Write as _},
    net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs as _, UdpSocket},
    time::{Duration, Instant},
};

use serial2::SerialPort;

use crate::address::Address;

/// How long a TCP connection may take, and a write on TCP or a serial port.
const TIMEOUT: Duration = Duration::from_secs(2);
/// After so long without a datagram from the peer another one may take its place.
const PEER_SILENT: Duration = Duration::from_secs(5);

/// An open connection.
#[derive(Debug)]
pub(crate) enum Transport {
    Udp(Udp),
    Tcp(TcpStream),
    Serial(SerialPort),
}

#[derive(Debug)]
pub(crate) struct Udp {
    socket: UdpSocket,
    /// Where datagrams are sent, and when the last one came from there; without that time another one may take its place at once.
    peer: Option<(SocketAddr, Option<Instant>)>,
    /// Only datagrams from here are read. `None`: from the peer, or from anyone while there is none.
    only: Option<IpAddr>,
}

impl Transport {
    /// Opens the address.
    pub fn open(address: &Address) -> io::Result<Self> {
        match address {
            Address::UdpIn { host, port } => Ok(Self::Udp(Udp {
                socket: UdpSocket::bind(resolve(host, *port)?.as_slice())?,
                peer: None,
                only: None,
            })),
            Address::UdpOut { host, port } => {
                let addresses = resolve(host, *port)?;
                let peer = *addresses.first().ok_or_else(|| no_address(host))?;
                let any: IpAddr = if peer.is_ipv4() {
                    [0, 0, 0, 0].into()
                } else {
                    [0; 16].into()
                };
                Ok(Self::Udp(Udp {
                    socket: UdpSocket::bind((any, 0))?,
                    peer: Some((peer, None)),
                    only: Some(peer.ip()),
                }))
            }
            Address::Tcp { host, port } => {
                let stream = connect(host, &resolve(host, *port)?)?;
                stream.set_nodelay(true)?;
                stream.set_write_timeout(Some(TIMEOUT))?;
                Ok(Self::Tcp(stream))
            }
            Address::Serial { path, baud } => {
                let mut port = SerialPort::open(path, *baud)?;
                port.set_write_timeout(TIMEOUT)?;
                Ok(Self::Serial(port))
            }
        }
    }

    /// Reads what is there, waiting for it up to `wait`. 0 if nothing came. An error means that the connection is gone.
    pub fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
        // A timeout of zero means forever.
        let wait = wait.max(Duration::from_millis(1));
        let read = match self {
            Self::Udp(udp) => return udp.receive(buffer, wait),
            Self::Tcp(stream) => stream
                .set_read_timeout(Some(wait))
                .and_then(|()| stream.read(buffer)),
            Self::Serial(port) => port.set_read_timeout(wait).and_then(|()| port.read(buffer)),
        };
        match read {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Err(error) if is_nothing(&error) => Ok(0),
            other => other,
        }
    }

    /// Sends bytes. Where there is nobody to send to yet, nothing happens. An error means that the connection is gone.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Udp(udp) => udp.send(bytes),
            Self::Tcp(stream) => stream.write_all(bytes),
            Self::Serial(port) => port.write_all(bytes),
        }
    }

    /// Reads datagrams of anyone again, where the address does not say whose. Until one comes, the last sender is still sent to: an
    /// autopilot that cannot be understood yet, since the clock of its signatures stands still, sets it by ours.
    pub fn forget_peer(&mut self) {
        if let Self::Udp(udp) = self
            && udp.only.is_none()
            && let Some((_, heard)) = &mut udp.peer
        {
            *heard = None;
        }
    }
}

impl Udp {
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.socket.set_read_timeout(Some(wait))?;
        let (length, from) = match self.socket.recv_from(buffer) {
            Ok(received) => received,
            Err(error) if is_nothing(&error) || is_unreachable(&error) => return Ok(0),
            Err(error) => return Err(error),
        };
        let expected = match (self.only, self.peer) {
            (Some(ip), _) => from.ip() == ip,
            (None, Some((peer, heard))) => {
                peer == from || heard.is_none_or(|heard| heard.elapsed() > PEER_SILENT)
            }
            (None, None) => true,
        };
        if !expected {
            return Ok(0);
        }
        let to = match (self.only, self.peer) {
            (Some(_), Some((peer, _))) => peer,
            _ => from,
        };
        self.peer = Some((to, Some(Instant::now())));
        Ok(length)
    }

    fn send(&self, bytes: &[u8]) -> io::Result<()> {
        let Some((peer, _)) = self.peer else {
            return Ok(());
        };
        match self.socket.send_to(bytes, peer) {
            Ok(_) => Ok(()),
            Err(error) if is_nothing(&error) || is_unreachable(&error) => Ok(()),
            Err(error) => Err(error),
        }
    }
}

/// Whether the error says only that nothing came.
fn is_nothing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

/// Whether the error says only that nobody listens at the other end of a UDP socket now.
fn is_unreachable(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::ConnectionRefused
            | ErrorKind::ConnectionReset
            | ErrorKind::NetworkUnreachable
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkDown
    )
}

/// The addresses of a host.
fn resolve(host: &str, port: u16) -> io::Result<Vec<SocketAddr>> {
    Ok(ipv4_first((host, port).to_socket_addrs()?.collect()))
}

/// Autopilots, simulators and routers seldom listen on IPv6, which is what `localhost` and names of a local network often are first. A
/// datagram does not tell that nobody listens.
fn ipv4_first(mut addresses: Vec<SocketAddr>) -> Vec<SocketAddr> {
    addresses.sort_by_key(SocketAddr::is_ipv6);
    addresses
}

/// A connection to the first of a host's addresses that takes one.
fn connect(host: &str, addresses: &[SocketAddr]) -> io::Result<TcpStream> {
    let mut failure = None;
    for address in addresses {
        match TcpStream::connect_timeout(address, TIMEOUT) {
            Ok(stream) => return Ok(stream),
            Err(error) => {
                failure.get_or_insert(error);
            }
        }
    }
    Err(failure.unwrap_or_else(|| no_address(host)))
}

fn no_address(host: &str) -> io::Error {
    io::Error::new(ErrorKind::NotFound, format!("{host} has no address"))
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn of_several_addresses_the_one_that_listens_is_connected() {
        let listening = TcpListener::bind("127.0.0.1:0").unwrap();
        let listening_at = listening.local_addr().unwrap();
        let closed = TcpListener::bind("127.0.0.1:0").unwrap();
        let closed_at = closed.local_addr().unwrap();
        drop(closed);
        let stream = connect("two", &[closed_at, listening_at]).unwrap();
        assert_eq!(stream.peer_addr().unwrap(), listening_at);
        let refused = connect("one", &[closed_at]).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::ConnectionRefused);
        let error = connect("none", &[]).unwrap_err();
        assert_eq!(error.to_string(), "none has no address");
    }

    #[test]
    fn addresses_of_ipv4_come_first() {
        let of = |texts: [&str; 4]| {
            texts
                .map(|text| text.parse::<SocketAddr>().unwrap())
                .to_vec()
        };
        assert_eq!(
            ipv4_first(of([
                "[::1]:5760",
                "127.0.0.1:5760",
                "[fe80::1]:5760",
                "10.0.0.2:5760"
            ])),
            of([
                "127.0.0.1:5760",
                "10.0.0.2:5760",
                "[::1]:5760",
                "[fe80::1]:5760"
            ])
        );
    }
}
