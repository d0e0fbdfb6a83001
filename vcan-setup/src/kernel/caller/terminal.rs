//! The caller's terminal while a command in the guest uses it.

use std::io;

use rustix::process::getpgrp;
use rustix::termios::{
    OptionalActions, Termios, isatty, tcgetattr, tcgetpgrp, tcgetwinsize, tcsetattr,
};

use super::super::wire::Window;

/// A terminal that is both standard input and standard output.
#[derive(Debug)]
pub(super) struct Terminal {
    /// Its settings as we found them, while they are changed.
    found: Option<Termios>,
}

impl Terminal {
    /// The caller's terminal; none unless standard input and output are one and it is ours to use.
    pub(super) fn of_caller() -> Option<Self> {
        let both = isatty(io::stdin()) && isatty(io::stdout());
        let in_foreground = || tcgetpgrp(io::stdin()).is_ok_and(|group| group == getpgrp());
        (both && in_foreground()).then_some(Self { found: None })
    }

    /// The size of its window.
    pub(super) fn window(&self) -> Window {
        let size = tcgetwinsize(io::stdout());
        size.map_or(Window { rows: 24, columns: 80 }, |size| Window {
            rows: size.ws_row,
            columns: size.ws_col,
        })
    }

    /// Hands every key over as it is pressed: the guest's terminal gives them their meaning.
    pub(super) fn make_raw(&mut self) -> io::Result<()> {
        let found = tcgetattr(io::stdin())?;
        let mut raw = found.clone();
        raw.make_raw();
        tcsetattr(io::stdin(), OptionalActions::Drain, &raw)?;
        self.found = Some(found);
        Ok(())
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if let Some(found) = &self.found {
            // A terminal that is gone needs no settings.
            let _ = tcsetattr(io::stdin(), OptionalActions::Drain, found);
        }
    }
}
