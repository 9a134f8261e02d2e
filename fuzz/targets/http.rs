//! HTTP requests, as bytes of a connection to a service on a map of one tile: an answer or a closed connection, never a status of 500.
#![no_main]

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::sync::OnceLock;
use std::time::Duration;

use grimnet_fuzz_targets::file_of;
use grimnet_locate::Localizer;
use grimnet_serve::{Access, Limits, ServedMap, Service};
use libfuzzer_sys::fuzz_target;

const PACK: &[u8] = include_bytes!("../corpus/pack/one_tile.grim");

/// Longest time to read an answer: the events of a track have no end.
const MAX_ANSWER: Duration = Duration::from_secs(2);

fn service() -> SocketAddr {
    static SERVICE: OnceLock<SocketAddr> = OnceLock::new();
    *SERVICE.get_or_init(|| {
        // As the runtime of Rust does, which a program of libFuzzer lacks: a client may be gone when it is answered.
        // SAFETY: no handler is installed.
        unsafe { libc::signal(libc::SIGPIPE, libc::SIG_IGN) };
        let localizer = Localizer::open(file_of(PACK, "area.grim")).unwrap();
        let map = ServedMap::new("area", localizer, None).unwrap();
        let address = SocketAddr::from(([127, 0, 0, 1], 0));
        let limits = Limits::default();
        let service = Service::bind(address, Access::ThisMachine, vec![map], limits).unwrap();
        let address = service.address();
        std::thread::spawn(move || service.run(false).unwrap());
        address
    })
}

/// Sends bytes and the end of the connection, and reads what comes back.
fn answer(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut stream = TcpStream::connect(service())?;
    stream.set_read_timeout(Some(MAX_ANSWER))?;
    // The service may refuse before everything is sent.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(Shutdown::Write);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    Ok(answer)
}

/// The path of a track in the corpus: the service gives it another number.
const TRACK: &str = "/v1/tracks/1";

/// The input, with a track that there is in place of [`TRACK`].
fn with_track(bytes: &[u8]) -> Vec<u8> {
    let Some(at) = bytes
        .windows(TRACK.len())
        .position(|part| part == TRACK.as_bytes())
    else {
        return bytes.to_vec();
    };
    let begin = b"POST /v1/tracks HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: 0\r\n\r\n";
    let begun = answer(begin).unwrap_or_default();
    let begun = String::from_utf8_lossy(&begun);
    let place = begun
        .lines()
        .find_map(|line| line.strip_prefix("location: "))
        .unwrap_or(TRACK);
    [&bytes[..at], place.as_bytes(), &bytes[at + TRACK.len()..]].concat()
}

fuzz_target!(|bytes: &[u8]| {
    // No free port: those of earlier connections become free in time.
    let Ok(answer) = answer(&with_track(bytes)) else {
        return std::thread::sleep(Duration::from_millis(50));
    };
    let line = String::from_utf8_lossy(&answer[..answer.len().min(12)]);
    assert!(line.is_empty() || line.starts_with("HTTP/1."), "{line}");
    assert!(!line.ends_with("500"), "{line}");
});
