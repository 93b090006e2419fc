//! Limits, so that one client leaves room for others: on the connections of each address, on the messages of a client, and on
//! the time that a client may not read.

use std::collections::HashMap;
use std::io;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::Semaphore;
use tokio::time::{Sleep, sleep};

/// Connections of an address that are served at a time.
const MAX_SERVED: usize = 48;
/// Connections of an address that are open at a time; those that are not served wait.
const MAX_OPEN: usize = 96;

/// The connections of each address that has any.
#[derive(Debug, Clone, Default)]
pub(super) struct AddressShares(Arc<Mutex<HashMap<IpAddr, Share>>>);

#[derive(Debug)]
struct Share {
    open: usize,
    served: Arc<Semaphore>,
}

/// An open connection, which counts until it is dropped.
#[derive(Debug)]
pub(super) struct OpenConnection {
    shares: AddressShares,
    address: IpAddr,
    /// A permit is needed to be served.
    pub(super) served: Arc<Semaphore>,
}

impl AddressShares {
    fn lock(&self) -> MutexGuard<'_, HashMap<IpAddr, Share>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a connection; `None` if the address has as many as it may.
    pub(super) fn open(&self, address: IpAddr) -> Option<OpenConnection> {
        let mut shares = self.lock();
        let new = || Share { open: 0, served: Arc::new(Semaphore::new(MAX_SERVED)) };
        let share = shares.entry(address).or_insert_with(new);
        if share.open >= MAX_OPEN {
            return None;
        }
        share.open += 1;
        Some(OpenConnection { shares: self.clone(), address, served: Arc::clone(&share.served) })
    }
}

impl Drop for OpenConnection {
    fn drop(&mut self) {
        let mut shares = self.shares.lock();
        if let Some(share) = shares.get_mut(&self.address) {
            share.open -= 1;
        }
        shares.retain(|_, share| share.open > 0);
    }
}

/// Messages per second that are allowed in the long run.
const PER_SECOND: f64 = 200.0;
/// Messages that are allowed at once.
const BURST: f64 = 200.0;

/// A token bucket.
#[derive(Debug)]
pub(crate) struct MessageRate {
    tokens: f64,
    filled_at: Instant,
}

impl MessageRate {
    pub(crate) fn new(now: Instant) -> Self {
        Self { tokens: BURST, filled_at: now }
    }

    /// Counts a message; whether it is allowed.
    pub(crate) fn allows(&mut self, now: Instant) -> bool {
        self.tokens = (self.tokens + PER_SECOND * (now - self.filled_at).as_secs_f64()).min(BURST);
        self.filled_at = now;
        self.tokens -= 1.0;
        self.tokens >= 0.0
    }
}

/// How long a client may receive nothing while there is something to send.
const STALL_TIMEOUT: Duration = Duration::from_secs(8);

/// A connection on which a write fails if the client receives nothing for [`STALL_TIMEOUT`].
pub(super) struct StallGuard {
    stream: TcpStream,
    /// Set while a write waits for the client.
    stalled: Option<Pin<Box<Sleep>>>,
}

impl StallGuard {
    pub(super) fn new(stream: TcpStream) -> Self {
        Self { stream, stalled: None }
    }

    /// The result of a write, or an error once it has waited for too long.
    fn check(&mut self, context: &mut Context<'_>, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        if written.is_ready() {
            self.stalled = None;
            return written;
        }
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(STALL_TIMEOUT)));
        stalled.as_mut().poll(context).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for StallGuard {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for StallGuard {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.check(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, bytes);
        self.check(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_burst_is_allowed_then_the_long_term_rate() {
        let start = Instant::now();
        let mut rate = MessageRate::new(start);
        assert!((0..200).all(|_| rate.allows(start)));
        assert!(!rate.allows(start));
        let mut rate = MessageRate::new(start);
        assert!((0..10_000).all(|i| rate.allows(start + Duration::from_millis(6 * i))));
    }
}
