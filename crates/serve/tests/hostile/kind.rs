//! One kind of hostile requests: what the client does, and how the service may end it.

use std::fmt;
use std::io::Write as _;
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::Duration;

use crate::client::{connect, read_all};

/// Requests that send or compute much are sent once among so many.
const RARE: usize = 100;

/// Connections of a crowd.
const CROWD: usize = 32;

/// Pause between two bytes of a client that trickles.
const TRICKLE_PAUSE: Duration = Duration::from_millis(50);

/// How a request ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// With an answer of this status.
    Status(u16),
    /// The service closed the connection without an answer.
    Closed,
    /// The client went away.
    Left,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Status(status) => write!(f, "status {status}"),
            Self::Closed => f.write_str("closed without an answer"),
            Self::Left => f.write_str("the client went away"),
        }
    }
}

/// What a client does.
pub enum Act {
    /// Sends a request, another one for each number, and reads the answer.
    Ask(Box<dyn Fn(usize) -> Vec<u8> + Sync>),
    /// Sends a part of a request, ends its side of the connection, and reads the answer.
    Cut(Vec<u8>),
    /// Sends a part of a request, says nothing more, and reads until the service ends the connection.
    Stall(Vec<u8>),
    /// As many clients at the same time that say nothing.
    Crowd,
    /// Sends a part of a request, and the rest byte by byte without an end.
    Trickle(Vec<u8>),
    /// Sends the head of a request, and chunks until it is refused.
    Flood { head: Vec<u8>, chunks: usize },
    /// Sends the same request again and again, and reads nothing.
    Deaf(Vec<u8>),
    /// Sends a request or a part of it, and goes away.
    Leave(Vec<u8>),
}

/// One kind of hostile requests.
pub struct Kind {
    /// For the report.
    pub name: &'static str,
    act: Act,
    /// Outcomes that are right.
    allowed: Vec<Outcome>,
    is_rare: bool,
}

impl Kind {
    /// The kind of the request with a number: all in turn, rare ones seldom.
    pub fn of_number(kinds: &[Self], number: usize) -> &Self {
        let of = |is_rare: bool, turn: usize| {
            let all = || kinds.iter().filter(|kind| kind.is_rare == is_rare);
            all().nth(turn % all().count()).unwrap()
        };
        if number % RARE == RARE - 1 {
            of(true, number / RARE)
        } else {
            of(false, number)
        }
    }

    /// Whether an outcome is right.
    pub fn allows(&self, outcome: Outcome) -> bool {
        self.allowed.contains(&outcome)
    }

    /// Sends a request of this kind.
    pub fn send(&self, address: SocketAddr, number: usize) -> Outcome {
        let begun = |bytes: &[u8]| {
            let mut stream = connect(address);
            // The service may refuse before everything is sent, here and below.
            let _ = stream.write_all(bytes);
            stream
        };
        match &self.act {
            Act::Ask(request) => answer(begun(&request(number))),
            Act::Cut(bytes) => {
                let stream = begun(bytes);
                let _ = stream.shutdown(Shutdown::Write);
                answer(stream)
            }
            Act::Stall(bytes) => answer(begun(bytes)),
            Act::Crowd => {
                let crowd: Vec<_> = (0..CROWD).map(|_| connect(address)).collect();
                let outcomes = crowd.into_iter().map(answer);
                outcomes.fold(Outcome::Closed, Outcome::max)
            }
            Act::Trickle(bytes) => {
                let stream = begun(bytes);
                let mut sending = stream.try_clone().unwrap();
                let trickle = std::thread::spawn(move || {
                    while sending.write_all(b"x").is_ok() {
                        std::thread::sleep(TRICKLE_PAUSE);
                    }
                });
                let outcome = answer(stream);
                trickle.join().unwrap();
                outcome
            }
            Act::Flood { head, chunks } => {
                let mut stream = begun(head);
                let chunk = [b"10000\r\n".to_vec(), vec![0xFF; 0x10000], b"\r\n".to_vec()].concat();
                let mut sending = stream.try_clone().unwrap();
                for _ in 0..*chunks {
                    if sending.write_all(&chunk).is_err() {
                        break;
                    }
                }
                // What was sent and not read makes a reset of the end of the connection.
                let _ = stream.flush();
                answer(stream)
            }
            Act::Deaf(bytes) => {
                let mut stream = begun(bytes);
                while stream.write_all(bytes).is_ok() {}
                Outcome::Closed
            }
            Act::Leave(bytes) => {
                drop(begun(bytes));
                Outcome::Left
            }
        }
    }
}

/// Reads until the service ends the connection.
fn answer(mut stream: TcpStream) -> Outcome {
    let bytes = read_all(&mut stream);
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(12)]).into_owned();
    match head
        .strip_prefix("HTTP/1.1 ")
        .or(head.strip_prefix("HTTP/1.0 "))
    {
        Some(status) => Outcome::Status(status.parse().unwrap()),
        None => {
            assert!(bytes.is_empty(), "{head}");
            Outcome::Closed
        }
    }
}

pub fn kind(name: &'static str, act: Act, allowed: &[Outcome]) -> Kind {
    Kind {
        name,
        act,
        allowed: allowed.to_vec(),
        is_rare: false,
    }
}

pub fn rare(kind: Kind) -> Kind {
    Kind {
        is_rare: true,
        ..kind
    }
}

/// The same request each time.
pub fn ask(bytes: Vec<u8>) -> Act {
    Act::Ask(Box::new(move |_| bytes.clone()))
}

/// One request after the other.
pub fn ask_each(all: Vec<Vec<u8>>) -> Act {
    Act::Ask(Box::new(move |number| {
        // The numbers of one kind are apart by the number of kinds, which may divide that of the requests.
        all[number / 7 % all.len()].clone()
    }))
}

/// Where a localisation is asked for, the queue may be full.
pub const BUSY: Outcome = Outcome::Status(503);
