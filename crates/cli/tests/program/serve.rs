//! `grim serve` as a program: what it is started with, and what it answers then.

use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use predicates::str::contains;

use super::{demo, grim, pack};

/// A service on a free port, which ends with the test.
pub struct Service {
    program: Child,
    host: String,
}

impl Service {
    /// Starts it with arguments besides the address.
    pub fn start<A: AsRef<OsStr>>(arguments: &[A]) -> Self {
        let mut program = Command::new(assert_cmd::cargo::cargo_bin("grim"))
            .args(["serve", "--listen", "127.0.0.1:0"])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut address = String::new();
        BufReader::new(program.stdout.take().unwrap())
            .read_line(&mut address)
            .unwrap();
        let host = address.trim().trim_start_matches("http://").to_owned();
        Self { program, host }
    }

    /// The answer to a request, head and body; `line` is such as `GET /v1/maps`, headers are lines with line ends.
    pub fn ask(&self, line: &str, headers: &str, body: &[u8]) -> String {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let head = format!(
            "{line} HTTP/1.1\r\nhost: {}\r\nconnection: close\r\n{headers}content-length: {}\r\n\r\n",
            self.host,
            body.len()
        );
        // The service may answer before it has everything.
        let _ = stream
            .write_all(head.as_bytes())
            .and_then(|()| stream.write_all(body));
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        answer
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

/// Not after a minute of work.
#[test]
fn a_demo_that_cannot_be_served_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap().to_string();
    for (address, said) in [
        (taken.as_str(), "choose another address or port"),
        // The demo has no option for a token.
        ("0.0.0.0:0", "in the variable GRIM_TOKEN"),
    ] {
        grim()
            .args(["demo", "--serve", address, "--out"])
            .arg(&out)
            .env_remove("GRIM_TOKEN")
            .timeout(Duration::from_secs(60))
            .assert()
            .code(2)
            .stderr(contains(said));
        assert!(!out.exists());
    }
}

/// The service would answer without one otherwise.
#[cfg(unix)]
#[test]
fn a_token_that_no_client_can_send_is_refused() {
    use std::os::unix::ffi::OsStrExt as _;

    for token in [&b""[..], b"short", b"p\xe4ssword-p\xe4ssword-p\xe4ssword"] {
        grim()
            .args(["serve", "--pack", "absent.grim", "--listen", "127.0.0.1:0"])
            .env("GRIM_TOKEN", OsStr::from_bytes(token))
            .assert()
            .code(2)
            .stderr(contains("GRIM_TOKEN: expected a token"));
    }
}

#[test]
fn a_map_is_shown_for_all_packs_that_were_built_from_it() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other.grim");
    fs::copy(pack(), &other).unwrap();
    let map = demo().join("map.tif");
    for maps in [1, 2] {
        let mut arguments = vec!["--pack".into(), pack(), other.clone()];
        arguments.push("--map".into());
        arguments.extend(std::iter::repeat_n(map.clone(), maps));
        let answer = Service::start(&arguments).ask("GET /v1/maps", "", &[]);
        let with_picture = answer.matches("\"has_picture\":true").count();
        assert_eq!(with_picture, 2, "{answer}");
    }
}
