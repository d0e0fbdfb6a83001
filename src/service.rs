//! A TCP service beside a run: a thread of the supervisor, less urgent than any other.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::thread::{self, JoinHandle};

use tokio::sync::oneshot;
use tokio::task::LocalSet;

/// How much less urgent than usual a service is: as little as there is.
const NICENESS: i32 = 19;

/// A service at work, which reports an `R` at its end.
#[derive(Debug)]
pub struct Service<R> {
    address: SocketAddr,
    stop: oneshot::Sender<()>,
    thread: JoinHandle<io::Result<R>>,
}

impl<R: Send + 'static> Service<R> {
    /// Opens the port and has `serve` run in a thread of that name until it ends by itself or is
    /// told to stop; then `report` says what happened. Both share the state that `prepare` makes
    /// there.
    ///
    /// # Errors
    /// When the port or the thread cannot be had.
    pub fn listen<S: 'static>(
        name: &str,
        address: SocketAddr,
        prepare: impl FnOnce() -> S + Send + 'static,
        serve: impl AsyncFnOnce(tokio::net::TcpListener, &S) -> io::Result<()> + Send + 'static,
        report: fn(&S) -> R,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let (stop, stopped) = oneshot::channel();
        let run = move || {
            // Where that is refused, it runs like any other thread.
            let _ = rustix::process::nice(NICENESS);
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
            let state = prepare();
            LocalSet::new().block_on(&runtime, async {
                let listener = tokio::net::TcpListener::from_std(listener)?;
                tokio::select! {
                    ended = serve(listener, &state) => ended,
                    _ = stopped => Ok(()),
                }
            })?;
            Ok(report(&state))
        };
        let thread = thread::Builder::new().name(name.into()).spawn(run)?;
        Ok(Self { address, stop, thread })
    }

    /// Where it listens.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Ends all connections.
    pub fn finish(self) -> Option<R> {
        // Nobody listening means that it has ended by itself.
        let _ = self.stop.send(());
        self.thread.join().ok()?.ok()
    }
}
