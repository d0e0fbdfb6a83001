//! `platoon vcan up` and `down`.

use std::fmt;
use std::time::Duration;

use clap::Args;
use vcan_setup::can::{self, CanError};
use vcan_setup::host::Host;

use crate::failure::Failure;

/// How long interfaces are watched for traffic before they are removed or called quiet.
pub(super) const WATCH: Duration = Duration::from_millis(300);
/// Interfaces unless told otherwise: those of a rehearsal with four trucks.
const COUNT: u16 = 4;

/// Which interfaces.
#[derive(Debug, Clone, Args)]
pub struct Interfaces {
    /// How many: truck0, truck1, ...
    #[arg(long, value_name = "N", default_value_t = COUNT,
          value_parser = clap::value_parser!(u16).range(1..=256))]
    count: u16,
    /// Their names instead.
    #[arg(long, value_name = "NAME,NAME,...", value_delimiter = ',', conflicts_with = "count")]
    names: Vec<String>,
}

impl Interfaces {
    /// The names asked for.
    pub(super) fn names(&self) -> Vec<String> {
        if self.names.is_empty() { numbered(self.count.into()) } else { self.names.clone() }
    }

    /// Makes them.
    pub(super) fn up(&self) -> Result<(), Failure> {
        let names = self.names();
        let made = can::ensure_vcan(&words(&names)).map_err(with_remedies)?;
        for vcan in &made.created {
            anstream::println!("{}: made", vcan.name);
        }
        for name in &made.reused {
            anstream::println!("{name}: was there already");
        }
        Ok(())
    }

    /// Removes them.
    pub(super) fn down(&self) -> Result<(), Failure> {
        let names = self.names();
        let done = can::remove_idle(&words(&names), WATCH).map_err(with_remedies)?;
        for name in &done.removed {
            anstream::println!("{name}: removed");
        }
        for name in &done.absent {
            anstream::println!("{name}: was not there");
        }
        Ok(())
    }
}

/// The names a rehearsal uses by itself.
pub(super) fn numbered(count: usize) -> Vec<String> {
    (0..count).map(|number| format!("truck{number}")).collect()
}

pub(super) fn words(names: &[String]) -> Vec<&str> {
    names.iter().map(String::as_str).collect()
}

/// The failure in one line, and where it is the machine's under it the commands that mend it, the
/// one for here first.
fn with_remedies(error: CanError) -> Failure {
    struct Page(CanError, Host);
    impl fmt::Display for Page {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            let Self(error, host) = self;
            write!(f, "{error}")?;
            let Some(lack) = error.lack() else {
                return Ok(());
            };
            write!(f, "\nThis is {}. What mends it, here first:", host.name)?;
            for remedy in host.remedies(lack) {
                write!(f, "\n  {:<10} {}", remedy.place, remedy.command)?;
            }
            Ok(())
        }
    }
    match error {
        CanError::BadName(_) => Failure::usage(error),
        _ => Failure::cannot_start(Page(error, Host::detect())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lack_of_this_machine_is_answered_with_a_list_of_commands() {
        let error = CanError::NotPermitted { name: "truck0".into() };
        let page = with_remedies(error).to_string();
        assert!(page.lines().count() > 3 && page.contains("vcan up"), "{page}");
    }

    #[test]
    fn a_wrong_name_is_answered_in_one_line() {
        let page = with_remedies(CanError::BadName("a b".into())).to_string();
        assert_eq!(page.lines().count(), 1, "{page}");
    }
}
