//! Why the command ends without a verdict, and with which exit code.

use std::fmt;
use std::process::ExitCode;

/// The behaviour passed the scenario's criteria.
pub const EXIT_PASSED: u8 = 0;
/// The behaviour failed them.
pub const EXIT_FAILED: u8 = 1;
/// The command line or a file makes no sense.
pub const EXIT_USAGE: u8 = 2;
/// The deadlines cannot be judged, because the machine itself was too late.
pub const EXIT_INCONCLUSIVE: u8 = 4;
/// The run could not start.
pub const EXIT_CANNOT_START: u8 = 3;

/// An end without a verdict. One line: what, and the remedy.
#[derive(Debug)]
pub struct Failure {
    code: u8,
    line: String,
}

impl Failure {
    /// The user asked for something that makes no sense.
    pub fn usage(line: impl fmt::Display) -> Self {
        Self { code: EXIT_USAGE, line: line.to_string() }
    }

    /// The machine does not allow what was asked for.
    pub fn cannot_start(line: impl fmt::Display) -> Self {
        Self { code: EXIT_CANNOT_START, line: line.to_string() }
    }

    /// Another end, with an exit code of its own.
    pub fn with_code(code: u8, line: impl fmt::Display) -> Self {
        Self { code, line: line.to_string() }
    }

    /// Its exit code.
    pub fn exit_code(&self) -> ExitCode {
        self.code.into()
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.line)
    }
}
