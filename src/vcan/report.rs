//! `platoon vcan check`.

use std::env;
use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use vcan_setup::check::{self, Finding, Findings, State};
use vcan_setup::kernel::Kernel;
use vcan_setup::realtime::environment;

use super::interfaces::{Interfaces, WATCH, words};
use crate::failure::Failure;
use crate::process;

/// Options of `vcan check`.
#[derive(Debug, Clone, Args)]
pub struct CheckArgs {
    /// The interfaces of the rehearsal.
    #[command(flatten)]
    interfaces: Interfaces,
    /// Where to write the findings as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Looks, and says what it saw.
pub(super) fn run(args: &CheckArgs) -> Result<(), Failure> {
    let kernel = Kernel::find(None, None, &env::var_os("PATH").unwrap_or_default());
    let names = args.interfaces.names();
    let findings = check::look(&words(&names), &kernel, &environment(), WATCH);
    anstream::print!("{}", page(&findings));
    if let Some(path) = &args.json {
        process::write_json(path, &findings)?;
    }
    if findings.can_rehearse {
        Ok(())
    } else {
        let instead = match kernel {
            Ok(_) => "rehearse in another kernel: platoon vcan shell -- platoon rehearse",
            Err(_) => "take --bus udp",
        };
        Err(Failure::cannot_start(format!(
            "no rehearsal over vcan here: mend what is missing above, or {instead}"
        )))
    }
}

/// The findings for people.
fn page(findings: &Findings) -> String {
    let mut page = format!("{}\n\nCAN\n", findings.host);
    add(&mut page, &findings.can);
    page.push_str("\nReal time\n");
    add(&mut page, &findings.real_time);
    page
}

fn add(page: &mut String, findings: &[Finding]) {
    for finding in findings {
        let Finding { subject, state, found, remedy } = finding;
        let style = match state {
            State::Ok => anstyle::AnsiColor::Green,
            State::Warn => anstyle::AnsiColor::Yellow,
            State::Missing => anstyle::AnsiColor::Red,
        }
        .on_default();
        // Writing to a string cannot fail.
        let _ = writeln!(page, "  {style}{state:<8}{style:#} {subject:<17} {found}");
        if let Some(remedy) = remedy {
            let _ = writeln!(page, "{:29}-> {remedy}", "");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_finding_has_its_line_and_every_remedy_its_own() {
        let kernel = Kernel::find(None, None, "".as_ref());
        let findings = check::look(&["nosuch0"], &kernel, &environment(), WATCH);
        let page = page(&findings);
        for finding in findings.can.iter().chain(&findings.real_time) {
            assert!(page.contains(&finding.found), "{finding:?}");
            assert!(finding.remedy.iter().all(|remedy| page.contains(remedy)), "{finding:?}");
        }
    }
}
