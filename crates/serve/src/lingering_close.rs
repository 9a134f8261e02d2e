//! A connection that is closed in two steps where its client may still be sending.
//!
//! A request is often refused before its body has arrived. If the connection were closed at once, the system would answer the rest of
//! the body with a reset, and many clients would find the reset instead of the answer. So the answer is sent, then our side of the
//! connection is closed, and what still comes is read and dropped until the client closes its side. That must not take long: each
//! connection takes one of few places.

use std::io;
use std::mem::MaybeUninit;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::extract::Request;
use axum::http::{HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep_until};

use crate::limits::Limits;

/// Time for the rest of a request after its answer.
const GRACE: Duration = Duration::from_secs(2);

/// So many bytes of the rest extend the time by a second: a client that sends a photo at 2 Mbit/s or faster may finish and find its
/// answer, one that sends byte by byte may not.
const BYTES_FOR_A_SECOND: f64 = 256.0 * 1024.0;

/// Bytes that are read at once.
const CHUNK_BYTES: usize = 16 << 10;

/// Whether bytes have come that belong to no request which was taken in: its client may still be sending. One for each connection.
#[derive(Debug, Clone, Default)]
pub(crate) struct Unread(Arc<AtomicBool>);

impl Unread {
    fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    fn set(&self, is_unread: bool) {
        self.0.store(is_unread, Ordering::Relaxed);
    }
}

/// Closes the connection after a refused request that has a body, of which there may be a rest. Requests carry the [`Unread`] of their
/// connection.
pub(crate) async fn close_after_refusal(request: Request, next: Next) -> Response {
    let unread = request.extensions().get::<Unread>().cloned();
    let has_body = !axum::body::HttpBody::is_end_stream(request.body());
    let mut response = next.run(request).await;
    let status = response.status();
    if has_body && (status.is_client_error() || status.is_server_error()) {
        let close = HeaderValue::from_static("close");
        response.headers_mut().insert(header::CONNECTION, close);
    } else if let Some(unread) = unread {
        unread.set(false);
    }
    response
}

/// A stream whose shutdown ends when the other side has closed it too, if that may still be sending.
pub(crate) struct LingeringClose<S> {
    stream: S,
    unread: Unread,
    grace: Duration,
    max_bytes: u64,
    max_time: Duration,
    /// What comes after our side is closed; `None` before that.
    rest: Option<Rest>,
}

struct Rest {
    begin: Instant,
    bytes: u64,
    deadline: Pin<Box<Sleep>>,
}

impl<S> LingeringClose<S> {
    /// Reads a rest of `limits.max_body_bytes` and for `limits.body_time` at most.
    pub(crate) fn new(stream: S, limits: &Limits) -> Self {
        Self {
            stream,
            unread: Unread::default(),
            grace: GRACE,
            max_bytes: limits.max_body_bytes as u64,
            max_time: limits.body_time,
            rest: None,
        }
    }

    /// For the requests of this connection.
    pub(crate) fn unread(&self) -> Unread {
        self.unread.clone()
    }
}

impl<S: AsyncRead + Unpin> LingeringClose<S> {
    /// Reads and drops what comes until the other side has closed, or the time is over.
    fn poll_rest(&mut self, context: &mut Context<'_>) -> Poll<()> {
        let until = |begin: Instant, bytes: u64| {
            let earned = Duration::from_secs_f64(bytes as f64 / BYTES_FOR_A_SECOND);
            begin + (self.grace + earned).min(self.max_time)
        };
        let rest = self.rest.get_or_insert_with(|| {
            let begin = Instant::now();
            Rest {
                begin,
                bytes: 0,
                deadline: Box::pin(sleep_until(until(begin, 0))),
            }
        });
        while rest.deadline.as_mut().poll(context).is_pending() {
            let mut chunk = [MaybeUninit::uninit(); CHUNK_BYTES];
            let mut buffer = ReadBuf::uninit(&mut chunk);
            let read = ready!(Pin::new(&mut self.stream).poll_read(context, &mut buffer));
            let length = buffer.filled().len() as u64;
            rest.bytes += length;
            if read.is_err() || length == 0 || rest.bytes > self.max_bytes {
                break;
            }
            let later = until(rest.begin, rest.bytes);
            rest.deadline.as_mut().reset(later);
        }
        Poll::Ready(())
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for LingeringClose<S> {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        let read = Pin::new(&mut this.stream).poll_read(context, buffer);
        if buffer.filled().len() > before {
            this.unread.set(true);
        }
        read
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> AsyncWrite for LingeringClose<S> {
    fn poll_write(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.get_mut().stream).poll_write(context, bytes)
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.get_mut().stream).poll_write_vectored(context, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_flush(context)
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        if this.rest.is_none() {
            ready!(Pin::new(&mut this.stream).poll_shutdown(context))?;
            if !this.unread.is_set() {
                return Poll::Ready(Ok(()));
            }
        }
        this.poll_rest(context).map(Ok)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, DuplexStream, duplex};
    use tokio::time::{sleep, timeout};

    use super::*;

    /// Only a watchdog.
    const WATCHDOG: Duration = Duration::from_secs(60);

    /// A little grace, and an hour for all.
    async fn begun(max_body_bytes: usize) -> (LingeringClose<DuplexStream>, DuplexStream) {
        let limits = Limits {
            max_body_bytes,
            body_time: Duration::from_secs(3600),
            ..Limits::default()
        };
        let (near, mut far) = duplex(1 << 16);
        let mut stream = LingeringClose::new(near, &limits);
        stream.grace = Duration::from_millis(50);
        far.write_all(b"a request").await.unwrap();
        let mut request = [0; 9];
        stream.read_exact(&mut request).await.unwrap();
        (stream, far)
    }

    async fn close(mut stream: LingeringClose<DuplexStream>) {
        timeout(WATCHDOG, stream.shutdown()).await.unwrap().unwrap();
    }

    #[tokio::test]
    async fn a_client_that_sends_byte_by_byte_is_not_waited_for() {
        let (stream, mut far) = begun(64 << 20).await;
        let trickle = tokio::spawn(async move {
            while far.write_all(b"x").await.is_ok() {
                sleep(Duration::from_millis(10)).await;
            }
        });
        close(stream).await;
        timeout(WATCHDOG, trickle).await.unwrap().unwrap();
    }

    #[tokio::test]
    async fn a_client_that_sends_a_photo_may_finish() {
        let (stream, mut far) = begun(64 << 20).await;
        let sending = tokio::spawn(async move {
            far.write_all(&vec![0; 8 << 20]).await.unwrap();
            // Longer than the grace, and shorter than what it has earned.
            sleep(Duration::from_millis(500)).await;
            far.write_all(b"the end").await.unwrap();
        });
        close(stream).await;
        sending.await.unwrap();
    }

    #[tokio::test]
    async fn a_client_that_sends_without_end_is_cut_off() {
        let (stream, mut far) = begun(1 << 20).await;
        let flood = tokio::spawn(async move { while far.write_all(&[0; 4096]).await.is_ok() {} });
        close(stream).await;
        timeout(WATCHDOG, flood).await.unwrap().unwrap();
    }

    #[tokio::test]
    async fn nothing_is_read_if_all_was_taken_in() {
        let (mut stream, mut far) = begun(1 << 20).await;
        stream.unread().set(false);
        stream.grace = Duration::from_secs(3600);
        far.write_all(b"more").await.unwrap();
        close(stream).await;
    }
}
