//! Showing how far a run is, without getting in its way.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Steps of the bar: milliseconds of bench time.
const STEPS_PER_S: f64 = 1e3;

/// The line that shows how far a run is; silent when standard error is no terminal.
pub struct ProgressLine {
    bar: ProgressBar,
}

impl ProgressLine {
    /// A line for a run of `duration_s` seconds of bench time.
    pub fn new(duration_s: f64) -> Self {
        let target = if std::io::stderr().is_terminal() {
            ProgressDrawTarget::stderr_with_hz(5)
        } else {
            ProgressDrawTarget::hidden()
        };
        Self::on(target, duration_s)
    }

    /// A line that nobody sees, where something else is drawn.
    pub fn hidden() -> Self {
        Self::on(ProgressDrawTarget::hidden(), 1.0)
    }

    fn on(target: ProgressDrawTarget, duration_s: f64) -> Self {
        let bar = ProgressBar::with_draw_target(Some((duration_s * STEPS_PER_S) as u64), target);
        let style =
            ProgressStyle::with_template("{bar:32.cyan/dim} {msg}  (Ctrl-C ends it cleanly)")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style);
        Self { bar }
    }

    /// A line for many runs, which knows its length in shares of the whole.
    pub fn counting() -> Self {
        Self::new(1.0)
    }

    /// Shows the share that is done.
    pub fn show_share(&self, share: f64, what: &str) {
        self.bar.set_position((share * STEPS_PER_S) as u64);
        self.bar.set_message(what.to_owned());
    }

    /// Says what is going on before bench time runs.
    pub fn say(&self, what: &str) {
        self.bar.set_message(what.to_owned());
        self.bar.tick();
    }

    /// Shows the bench time.
    pub fn show(&self, time_s: f64, duration_s: f64) {
        self.bar.set_position((time_s * STEPS_PER_S) as u64);
        self.bar.set_message(format!("{time_s:6.1} of {duration_s:.0} s"));
    }

    /// Takes the line away.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}
