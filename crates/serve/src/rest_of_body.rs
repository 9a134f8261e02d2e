//! The rest of a body, which is taken in before an error is answered.
//!
//! A client that is still sending when the connection is closed finds it broken, and never reads the answer.

use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::Request;
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use futures_util::StreamExt as _;
use hyper::body::{Frame, SizeHint};
use tokio::time::{Instant, timeout, timeout_at};

use crate::limits::Limits;
use crate::state::Shared;

/// Reads and drops what a handler left of the body where it answers with an error. The limits of size and time are those of every
/// body, and the time counts from the head of the request. A client that waits to be asked for its body (`Expect: 100-continue`)
/// is not asked, one that is too slow is not waited for, and a body that is longer than the limit is not begun.
pub(crate) async fn take_in_rest(
    axum::extract::State(state): Shared,
    request: Request,
    next: Next,
) -> Response {
    let deadline = Instant::now() + state.limits.body_time;
    if request.body().is_end_stream() {
        return next.run(request).await;
    }
    let waits_to_be_asked = request.headers().contains_key(header::EXPECT);
    let (parts, body) = request.into_parts();
    let body = LentBody::new(body);
    let request = Request::from_parts(parts, Body::new(body.clone()));
    let response = next.run(request).await;
    let status = response.status();
    let is_error = status.is_client_error() || status.is_server_error();
    let is_awaited = status != StatusCode::REQUEST_TIMEOUT
        && (body.is_begun() || !waits_to_be_asked)
        && body.size_hint().lower() <= state.limits.max_body_bytes as u64;
    if is_error && is_awaited {
        let dropped = drop_rest(body, &state.limits);
        // Who has not sent it by then gets the answer nevertheless.
        let _ = timeout_at(deadline, dropped).await;
    }
    response
}

async fn drop_rest(body: LentBody, limits: &Limits) {
    let mut stream = Body::new(body).into_data_stream();
    let mut left = limits.max_body_bytes;
    while let Ok(Some(Ok(chunk))) = timeout(limits.body_pause, stream.next()).await {
        match left.checked_sub(chunk.len()) {
            Some(less) => left = less,
            None => return,
        }
    }
}

/// A body that a handler reads, and of which the rest is still there when it has dropped it.
#[derive(Clone)]
struct LentBody(Arc<Mutex<Lent>>);

struct Lent {
    body: Body,
    /// Somebody asked for its first bytes.
    is_begun: bool,
}

impl LentBody {
    fn new(body: Body) -> Self {
        let is_begun = false;
        Self(Arc::new(Mutex::new(Lent { body, is_begun })))
    }

    fn is_begun(&self) -> bool {
        self.lent().is_begun
    }

    fn lent(&self) -> MutexGuard<'_, Lent> {
        // A body after a panic is one that breaks off at worst.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl HttpBody for LentBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let mut lent = self.lent();
        lent.is_begun = true;
        Pin::new(&mut lent.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.lent().body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.lent().body.size_hint()
    }
}
