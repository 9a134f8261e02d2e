//! Who may ask.

use std::net::SocketAddr;

use grimnet_serve::{Access, Limits, ServeError, Service, Token};

use crate::area::{Running, area, shared};
use crate::client::{Answer, get, send, send_raw};

const SECRET: &str = "correct-horse-battery-staple";

#[test]
fn another_address_needs_a_token() {
    let everywhere = SocketAddr::from(([0, 0, 0, 0], 0));
    let maps = vec![area().served("area", false)];
    let error = Service::bind(everywhere, Access::ThisMachine, maps, Limits::default());
    assert!(
        matches!(error, Err(ServeError::Unprotected { .. })),
        "{error:?}"
    );
    let none = Service::bind(everywhere, Access::Everybody, Vec::new(), Limits::default());
    assert!(matches!(none, Err(ServeError::NoMaps)), "{none:?}");
}

#[test]
fn only_those_with_the_token_are_answered() {
    let access = Access::WithToken(Token::new(SECRET).unwrap());
    let maps = vec![area().served("area", false)];
    let running = Running::start(access, maps, Limits::default());
    for headers in [
        vec![],
        vec!["authorization: Bearer correct-horse-battery-stapl".to_owned()],
        vec![format!("authorization: Basic {SECRET}")],
        vec![format!("authorization: {SECRET}")],
        vec!["authorization: Bearer ".to_owned()],
    ] {
        let headers: Vec<&str> = headers.iter().map(String::as_str).collect();
        for line in [
            "GET /v1/maps",
            "POST /v1/locate",
            "GET /metrics",
            "GET /v1/nothing",
        ] {
            let answer = send(running.address, line, &headers, &[]);
            answer.problem(401, "token");
            assert!(
                answer
                    .header("www-authenticate")
                    .unwrap()
                    .starts_with("Bearer")
            );
        }
    }
    let right = format!("authorization: bearer {SECRET}");
    let answer = send(running.address, "GET /v1/maps", &[&right], &[]);
    assert_eq!(answer.status, 200);
    // A probe and the page, which asks for the token, need none.
    assert_eq!(get(running.address, "/healthz").status, 200);
    assert_eq!(get(running.address, "/api").status, 200);
}

#[test]
fn other_sites_and_other_names_are_refused() {
    let of = |head: &str| Answer::of(&send_raw(shared(), head.as_bytes()));
    let rebound = of("GET /v1/maps HTTP/1.1\r\nhost: evil.example\r\nconnection: close\r\n\r\n");
    rebound.problem(421, "host");
    let none = of("GET /v1/maps HTTP/1.0\r\n\r\n");
    none.problem(421, "host");
    let cross = send(
        shared(),
        "POST /v1/locate",
        &["origin: http://evil.example"],
        &[],
    );
    cross.problem(403, "origin");
    // A picture on a page of another site, which has no Origin.
    let picture = ["sec-fetch-site: cross-site", "sec-fetch-mode: no-cors"];
    send(shared(), "GET /v1/maps", &picture, &[]).problem(403, "origin");
    let own = format!("origin: http://{}", shared());
    assert_eq!(send(shared(), "GET /v1/maps", &[&own], &[]).status, 200);
}
