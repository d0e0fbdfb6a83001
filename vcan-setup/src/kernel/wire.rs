//! What caller and guest say to each other, and over which lines.
//!
//! The kernel's serial lines are joined to sockets of the caller. One carries the messages below,
//! the other two the bytes of the command's streams and nothing else, so that a stream nobody reads
//! holds up neither the messages nor the other stream. The guest speaks first: what arrives at a
//! serial line before it was opened and made raw is lost or changed.

use std::ffi::OsString;
use std::io::{self, Read, Write};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Lines between caller and guest.
pub(super) const LINES: usize = 3;
/// The line of the messages.
pub(super) const MESSAGES: usize = 0;
/// The line of standard output, and in the other direction of standard input.
pub(super) const OUTPUT: usize = 1;
/// The line of standard error.
pub(super) const ERRORS: usize = 2;
/// Longest message \[bytes\]: more than any argument list and environment the kernel takes.
const MESSAGE_BYTES_MAX: u32 = 16 << 20;

/// What the guest is to do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Job {
    /// The command and its arguments.
    pub(super) command: Vec<OsString>,
    /// Words that start this program as the one that takes a terminal and becomes the command.
    pub(super) on_terminal: Vec<OsString>,
    /// Its environment, and nothing else.
    pub(super) environment: Vec<(OsString, OsString)>,
    /// Its current directory.
    pub(super) folder: OsString,
    /// Its file mode creation mask.
    pub(super) umask: u32,
    /// The host's name.
    pub(super) host: OsString,
    /// Folder of the kernel's modules; none when it has CAN built in.
    pub(super) modules: Option<OsString>,
    /// CAN interfaces to make.
    pub(super) interfaces: Vec<String>,
    /// The window, when the command is to have a terminal.
    pub(super) window: Option<Window>,
    /// Whether standard error is that terminal too.
    pub(super) errors_to_terminal: bool,
}

/// Size of a terminal's window in characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Window {
    /// Lines.
    pub(super) rows: u16,
    /// Characters in a line.
    pub(super) columns: u16,
}

/// From the caller to the guest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum ToGuest {
    /// Begin.
    Start(Box<Job>),
    /// Standard input has ended after this many bytes.
    InputEnd(u64),
    /// A signal for the command.
    Signal(i32),
    /// The window has another size now.
    Resize(Window),
    /// Nobody reads what comes on this line any more.
    Unread(u8),
    /// Everything has arrived; power off.
    Farewell,
}

/// From the guest to the caller.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum ToCaller {
    /// The lines are open and raw.
    Ready,
    /// The command runs.
    Started,
    /// The job cannot be done, in words.
    Refused(String),
    /// The command has ended.
    Ended(Ending),
}

/// How the command ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Ending {
    /// Its exit status as a shell says it: 128 and the signal's number when one ended it.
    pub(super) status: u8,
    /// Bytes sent on each line of its streams.
    pub(super) sent: [u64; LINES],
    /// Processes the kernel killed because it had no memory left.
    pub(super) killed_for_memory: u64,
    /// Why what it wrote to files may not all be on the host's disk, if so.
    pub(super) unwritten: Option<String>,
}

/// Sends one message.
pub(super) fn send<T: Serialize>(line: &mut impl Write, message: &T) -> io::Result<()> {
    let body = postcard::to_allocvec(message).map_err(io::Error::other)?;
    let length = u32::try_from(body.len()).map_err(io::Error::other)?;
    let mut packet = length.to_le_bytes().to_vec();
    packet.extend(body);
    line.write_all(&packet)?;
    line.flush()
}

/// Waits for one message; none when the other side has closed the line.
pub(super) fn receive<T: DeserializeOwned>(line: &mut impl Read) -> io::Result<Option<T>> {
    let mut length = [0; 4];
    if let Err(error) = line.read_exact(&mut length) {
        let closed = error.kind() == io::ErrorKind::UnexpectedEof || is_hang_up(&error);
        return if closed { Ok(None) } else { Err(error) };
    }
    let length = u32::from_le_bytes(length);
    if length > MESSAGE_BYTES_MAX {
        return Err(io::Error::other(format!("a message of {length} bytes")));
    }
    let mut body = vec![0; length as usize];
    line.read_exact(&mut body)?;
    postcard::from_bytes(&body).map(Some).map_err(io::Error::other)
}

/// Whether an error says that the other end of a line or terminal is gone.
pub(super) fn is_hang_up(error: &io::Error) -> bool {
    matches!(error.raw_os_error(), Some(libc::EIO | libc::ECONNRESET | libc::EPIPE))
}

#[cfg(test)]
mod tests {
    use std::os::unix::ffi::OsStringExt;

    use super::*;

    #[test]
    fn arguments_that_are_not_text_arrive_as_they_were() {
        let job = Job {
            command: vec![OsString::from_vec(vec![0xff, b' ', b'"']), "".into()],
            on_terminal: Vec::new(),
            environment: vec![("A=B".into(), OsString::from_vec(vec![1, 0xfe]))],
            folder: "/a b".into(),
            umask: 0o027,
            host: "here".into(),
            modules: None,
            interfaces: vec!["truck0".into()],
            window: Some(Window { rows: 24, columns: 80 }),
            errors_to_terminal: false,
        };
        let mut line = Vec::new();
        send(&mut line, &ToGuest::Start(Box::new(job.clone()))).expect("memory takes it");
        let received: Option<ToGuest> = receive(&mut line.as_slice()).expect("whole");
        assert_eq!(received, Some(ToGuest::Start(Box::new(job))));
    }

    #[test]
    fn a_closed_line_is_not_an_error_and_a_cut_message_is() {
        assert_eq!(receive::<ToGuest>(&mut &[][..]).expect("closed"), None);
        let mut line = Vec::new();
        send(&mut line, &ToGuest::InputEnd(1 << 40)).expect("memory takes it");
        assert!(receive::<ToGuest>(&mut &line[..line.len() - 1]).is_err());
    }

    #[test]
    fn nonsense_is_no_reason_to_ask_for_all_memory() {
        assert!(receive::<ToGuest>(&mut &[0xff, 0xff, 0xff, 0xff, 0][..]).is_err());
    }
}
