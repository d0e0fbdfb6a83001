//! `--tui`: the run in a terminal while it lasts, for those who look over ssh.
//!
//! A thread of the supervisor, less urgent than any other, follows the recordings as the live view
//! does and draws five times a second. The loops do not know of it.

mod screen;
mod state;

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers};
use rustix::process::{Signal, getpid, kill_process};

use crate::failure::Failure;
use crate::live::Feed;
pub use state::Run;
use state::State;

/// Least urgent of all threads.
const NICENESS: i32 = 19;
/// Time between two pictures.
const PERIOD: Duration = Duration::from_millis(200);

/// Whether there is a terminal to draw on.
pub fn has_terminal() -> bool {
    std::io::stdout().is_terminal()
}

/// A dashboard being drawn.
#[derive(Debug)]
pub struct Dashboard {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Dashboard {
    /// Takes the terminal over.
    ///
    /// # Errors
    /// When it cannot be had.
    pub fn start(run: Run, feed: Feed) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| {
            Failure::cannot_start(format!("--tui: {error}; leave --tui out"))
        };
        let stop = Arc::new(AtomicBool::new(false));
        let terminal = ratatui::try_init().map_err(failed)?;
        let until = Arc::clone(&stop);
        let thread = thread::Builder::new()
            .name("dashboard".into())
            .spawn(move || draw(terminal, State::new(run), feed, &until))
            .map_err(failed)?;
        Ok(Self { stop, thread })
    }

    /// Gives the terminal back.
    pub fn finish(self) {
        self.stop.store(true, Ordering::Relaxed);
        // A thread that panicked has given the terminal back already.
        let _ = self.thread.join();
        ratatui::restore();
    }
}

fn draw(
    mut terminal: ratatui::DefaultTerminal,
    mut state: State,
    mut feed: Feed,
    stop: &AtomicBool,
) {
    // Where that is refused, it runs like any other thread.
    let _ = rustix::process::nice(NICENESS);
    while !stop.load(Ordering::Relaxed) {
        feed.follow(|message, _| state.take(message));
        // What cannot be drawn now is drawn next time.
        let _ = terminal.draw(|frame| screen::draw(frame, &state));
        state.begin_window();
        if is_end_asked() {
            // In raw mode the terminal sends no signal; the supervisor waits for one.
            let _ = kill_process(getpid(), Signal::INT);
        }
    }
}

/// Waits for the next picture; true when a key asks for the end.
fn is_end_asked() -> bool {
    if !event::poll(PERIOD).unwrap_or(false) {
        return false;
    }
    match event::read() {
        Ok(Event::Key(KeyEvent { code: KeyCode::Char('q'), .. })) => true,
        Ok(Event::Key(KeyEvent { code: KeyCode::Char('c'), modifiers, .. })) => {
            modifiers.contains(KeyModifiers::CONTROL)
        }
        _ => false,
    }
}
