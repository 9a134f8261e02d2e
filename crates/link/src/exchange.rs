//! One turn of a link: what arrived goes to the session, what it has to say goes out.

use std::time::Duration;

use grimnet_track::TrackPoint;

use crate::{clock::LinkClock, connection::Connection, event::LinkEvent, session::Session};

/// Waits up to `wait` for messages, gives them to the session, and sends what it answers. Returns what happened to the connection.
pub(crate) fn exchange(
    connection: &mut Connection,
    session: &mut Session,
    clock: &LinkClock,
    wait: Duration,
    point_at: &dyn Fn(f64) -> Option<TrackPoint>,
) -> Vec<LinkEvent> {
    let mut events = Vec::new();
    for (header, message) in connection.receive(wait, &mut events) {
        session.receive(&header, &message, clock.now_s());
    }
    if connection.has_received() && session.autopilot().is_none() {
        connection.forget_peer();
    }
    for message in session.poll(clock.now_s(), point_at) {
        connection.send(session.system_id(), &message, &mut events);
    }
    events
}
