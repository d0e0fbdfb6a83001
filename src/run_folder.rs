//! The folder of one run, and the names of the files in it.

use std::fs;
use std::path::{Path, PathBuf};

use jiff::Zoned;

use crate::failure::Failure;

/// The machine's floor in cyclictest's form: beside a trace, and attached to it.
pub const FLOOR: &str = "floor.json";

/// The folder a run writes into.
#[derive(Debug, Clone)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// Makes the folder: the one asked for, or `runs/<time>-<scenario>`.
    ///
    /// # Errors
    /// When it holds a run already, or cannot be made or written.
    pub fn create(asked: Option<&Path>, scenario: &str) -> Result<Self, Failure> {
        let folder = match asked {
            Some(path) => Self::open(path)?,
            None => Self::open(&unused_default(scenario))?,
        };
        if folder.trace().exists() || folder.summary().exists() {
            return Err(Failure::usage(format!(
                "--out {}: holds a run already; name another folder or remove this one",
                folder.path.display()
            )));
        }
        Ok(folder)
    }

    /// Takes a folder as it is, making it when there is none, and makes sure it can be written.
    ///
    /// # Errors
    /// When it cannot be made or written.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| {
            Failure::cannot_start(format!(
                "--out {}: {error}; name a folder that can be written",
                path.display()
            ))
        };
        fs::create_dir_all(path).map_err(failed)?;
        // The processes of a run try at the same time, each with a file of its own.
        let probe = path.join(format!(".writable-{}", std::process::id()));
        fs::write(&probe, b"").map_err(failed)?;
        fs::remove_file(&probe).map_err(failed)?;
        Ok(Self { path: path.to_path_buf() })
    }

    /// A folder that need not be there, for tests of names.
    #[cfg(test)]
    pub fn named(path: &str) -> Self {
        Self { path: path.into() }
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The merged trace.
    pub fn trace(&self) -> PathBuf {
        self.path.join("run.mcap")
    }

    /// The summary for programs.
    pub fn summary(&self) -> PathBuf {
        self.path.join("summary.json")
    }

    /// The page for people.
    pub fn report(&self) -> PathBuf {
        self.path.join("report.html")
    }

    /// How late the machine woke the sentinel beside the run, in cyclictest's form.
    pub fn floor(&self) -> PathBuf {
        self.path.join(FLOOR)
    }

    /// The table of a deadline test, for programs.
    pub fn deadline(&self) -> PathBuf {
        self.path.join("deadline.json")
    }

    /// The same for people.
    pub fn deadline_page(&self) -> PathBuf {
        self.path.join("deadline.md")
    }

    /// The scenario as it was run, overrides included.
    pub fn scenario(&self) -> PathBuf {
        self.path.join("scenario.toml")
    }

    /// The law's calibration, for the ECUs.
    pub fn law(&self) -> PathBuf {
        self.path.join("law.toml")
    }

    /// The same for a truck that is told more about itself than the others.
    pub fn law_of(&self, truck: u8) -> PathBuf {
        self.path.join(format!("law-{truck}.toml"))
    }

    /// What one process recorded.
    pub fn part(&self, process: &str) -> PathBuf {
        self.path.join(format!("{process}.part.mcap"))
    }

    /// What one process reported at its end.
    pub fn process_report(&self, process: &str) -> PathBuf {
        self.path.join(format!("{process}.json"))
    }

    /// What one process said on standard error.
    pub fn log(&self, process: &str) -> PathBuf {
        self.path.join(format!("{process}.log"))
    }
}

/// `runs/<time>-<scenario>`, with a number behind it when two runs start in the same second.
fn unused_default(scenario: &str) -> PathBuf {
    let stem = Path::new(scenario).file_stem().map_or(scenario.into(), |s| s.to_string_lossy());
    let name = format!("{}-{stem}", Zoned::now().strftime("%Y%m%d-%H%M%S"));
    let first = Path::new("runs").join(&name);
    (2..)
        .map(|n| Path::new("runs").join(format!("{name}-{n}")))
        .find(|path| !path.exists())
        .filter(|_| first.exists())
        .unwrap_or(first)
}
