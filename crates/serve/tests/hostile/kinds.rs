//! All kinds of hostile requests.

use std::net::SocketAddr;

use crate::kind::Kind;
use crate::request::Requests;
use crate::{bodies, clients, heads};

/// The kinds against a service at an address; `photo` is a JPEG photo that it takes.
pub fn kinds(address: SocketAddr, photo: &[u8]) -> Vec<Kind> {
    let requests = Requests { address };
    [
        bodies::lengths(&requests),
        bodies::bombs(&requests, photo),
        bodies::bodies(&requests, photo),
        bodies::forms(&requests, photo),
        heads::targets(&requests),
        heads::heads(&requests),
        clients::tracks(&requests),
        clients::slowness(&requests),
    ]
    .into_iter()
    .flatten()
    .collect()
}
