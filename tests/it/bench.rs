//! One run of the command itself: a fresh folder, its exit code and words, and what it left there.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use platoon::summary::Summary;
use platoon_dbc::Message as CanMessage;
use serde_json::Value;
use traces::{FrameRecord, Message, Reader, Record, Topic, TruthRecord};

/// How long any run may take before it counts as hung. Nothing is judged by it but hanging.
const LIMIT: Duration = Duration::from_secs(900);
/// Time between two looks at something that is waited for.
const LOOK: Duration = Duration::from_millis(20);

/// Where the command's words go, beside its folder.
const STDOUT: &str = "stdout";
/// Likewise.
const STDERR: &str = "stderr";

/// Runs `platoon` with these arguments and no folder of a run.
pub(crate) fn platoon(name: &str, arguments: &[&str]) -> Run {
    start(name, arguments).finish(LIMIT)
}

/// Runs `platoon` for as long as many runs take.
pub(crate) fn platoon_at_length(name: &str, arguments: &[&str]) -> Run {
    start(name, arguments).finish(16 * LIMIT)
}

/// Runs `platoon rehearse` into a fresh folder of that name.
pub(crate) fn rehearse(name: &str, arguments: &[&str]) -> Run {
    start_rehearsal(name, arguments).finish(LIMIT)
}

/// Rehearses in virtual time.
pub(crate) fn rehearse_virtually(name: &str, arguments: &[&str]) -> Run {
    rehearse(name, &[&["--virtual-time"], arguments].concat())
}

/// Starts `platoon rehearse` and leaves it running.
pub(crate) fn start_rehearsal(name: &str, arguments: &[&str]) -> Ongoing {
    let out = place(name).join("run");
    let out = out.to_str().expect("the place of the tests is UTF-8");
    start(name, &[&["rehearse"], arguments, &["--out", out]].concat())
}

/// Where the run of that name leaves what it leaves.
pub(crate) fn place(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// Starts `platoon` in an empty place of its own.
pub(crate) fn start(name: &str, arguments: &[&str]) -> Ongoing {
    let place = place(name);
    if place.exists() {
        fs::remove_dir_all(&place).expect("what an earlier run left can be removed");
    }
    fs::create_dir_all(&place).expect("the place of the tests can be written");
    let output = |name: &str| File::create(place.join(name)).expect("a file in a fresh folder");
    let child = Command::new(env!("CARGO_BIN_EXE_platoon"))
        .args(arguments)
        .current_dir(&place)
        .stdin(Stdio::null())
        .stdout(output(STDOUT))
        .stderr(output(STDERR))
        .spawn()
        .expect("the command starts");
    Ongoing { place, child: Some(child) }
}

/// Polls until there is an answer; panics when there is none for far too long.
pub(crate) fn eventually<T>(what: &str, limit: Duration, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < limit, "waited {limit:?} in vain: {what}");
        thread::sleep(LOOK);
    }
}

/// A run that has not ended yet. Dropped before its end, it is killed, and its children with it.
pub(crate) struct Ongoing {
    place: PathBuf,
    child: Option<Child>,
}

impl Ongoing {
    /// The folder of the run.
    pub(crate) fn out(&self) -> PathBuf {
        self.place.join("run")
    }

    /// What it has said on standard error until now.
    pub(crate) fn said(&self) -> String {
        fs::read_to_string(self.place.join(STDERR)).unwrap_or_default()
    }

    /// The process of the supervisor.
    pub(crate) fn pid(&self) -> u32 {
        self.child.as_ref().expect("only finishing takes it").id()
    }

    /// Waits for its end; panics when it hangs.
    pub(crate) fn finish(mut self, limit: Duration) -> Run {
        let mut child = self.child.take().expect("finished once");
        let status = eventually("the end of the command", limit, || {
            child.try_wait().expect("a child can be waited for")
        });
        let words = |name: &str| fs::read_to_string(self.place.join(name)).expect("UTF-8");
        Run { status, stdout: words(STDOUT), stderr: words(STDERR), place: self.place.clone() }
    }
}

impl Drop for Ongoing {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            // Its children end with it: they ask the kernel for that.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// A run that has ended. Its files are removed with it unless the test is failing.
pub(crate) struct Run {
    pub(crate) status: ExitStatus,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    place: PathBuf,
}

impl Run {
    /// Its exit code; none when a signal ended it.
    pub(crate) fn code(&self) -> Option<i32> {
        self.status.code()
    }

    /// The folder of the run.
    pub(crate) fn out(&self) -> PathBuf {
        self.place.join("run")
    }

    /// Names of what the command left beside its words, sorted.
    pub(crate) fn left_behind(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.place).expect("the place is still there");
        let name = |entry: io::Result<fs::DirEntry>| {
            entry.expect("an entry").file_name().to_string_lossy().into_owned()
        };
        let mut names: Vec<String> =
            entries.map(name).filter(|name| name != STDOUT && name != STDERR).collect();
        names.sort();
        names
    }

    /// `summary.json` as this program reads it.
    pub(crate) fn summary(&self) -> Summary {
        serde_json::from_value(self.json()).expect("the summary is what the library says it is")
    }

    /// `summary.json` as any program reads it.
    pub(crate) fn json(&self) -> Value {
        let path = self.out().join("summary.json");
        let text = fs::read(&path).unwrap_or_else(|e| {
            panic!("{}: {e}; the run said: {}{}", path.display(), self.stdout, self.stderr)
        });
        serde_json::from_slice(&text).expect("summary.json is JSON")
    }

    /// `run.mcap`, opened.
    pub(crate) fn trace(&self) -> Reader {
        Reader::open(&self.out().join("run.mcap")).expect("run.mcap opens")
    }

    /// The true world, every 10 ms.
    pub(crate) fn truth(&self) -> Vec<TruthRecord> {
        let truth = |message: Message| match message.record() {
            Ok(Record::Truth(truth)) => *truth,
            other => panic!("{other:?} on /world/truth"),
        };
        self.trace().with_topics(["/world/truth"]).map(truth).collect()
    }

    /// The commands on one truck's bus: encoded messages with their log times.
    pub(crate) fn commands(&self, bus: u8) -> Vec<(u64, Vec<u8>)> {
        self.trace()
            .with_topics([format!("/can/bus{bus}/frames")])
            .filter(|message| is_command(&frame(message)))
            .map(|message| (message.log_time_ns, message.data))
            .collect()
    }

    /// How many messages every topic has. Panics when anything in the trace cannot be read.
    pub(crate) fn messages_by_topic(&self) -> BTreeMap<String, usize> {
        let mut reader = self.trace();
        let mut counts = BTreeMap::new();
        for message in &mut reader {
            if message.channel.kind.is_some() {
                message.record().expect("every record of ours decodes");
            }
            *counts.entry(message.channel.topic.clone()).or_default() += 1;
        }
        assert!(reader.loss().is_none(), "unreadable: {:?}", reader.loss());
        counts
    }

    /// Asserts an exit code, showing what the run said when it is another.
    #[track_caller]
    pub(crate) fn expect_code(&self, code: i32) {
        assert_eq!(self.code(), Some(code), "{}\n{}", self.stdout, self.stderr);
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        if !thread::panicking() {
            // What cannot be removed only takes room until the next run of that name.
            let _ = fs::remove_dir_all(&self.place);
        }
    }
}

/// The frame of a message on `/can/bus<i>/frames`.
pub(crate) fn frame(message: &Message) -> FrameRecord {
    assert!(matches!(message.channel.kind, Some(Topic::Frames(_))), "{}", message.channel.topic);
    match message.record() {
        Ok(Record::Frame(frame)) => frame,
        other => panic!("{other:?} on {}", message.channel.topic),
    }
}

fn is_command(record: &FrameRecord) -> bool {
    matches!(CanMessage::decode(&record.frame), Ok((CanMessage::Actuation(_), _)))
}
