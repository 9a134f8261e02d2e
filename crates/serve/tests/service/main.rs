//! The service as clients see it: a real server on a free port, requests over TCP.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod access;
mod area;
mod client;
mod description;
mod hostile;
mod locating;
mod tiles;
mod tracks;
