//! `platoon vcan shell`: a command in the booted kernel is what it would be outside.
//!
//! Most of these boot a kernel and so need user-mode Linux; `./test.sh kernel` runs them.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

use crate::bench::{self, eventually};

/// How long a kernel may take for a small command before it counts as hung.
const LIMIT: Duration = Duration::from_secs(180);
/// Bytes of a stream that no buffer on the way can hold at once.
const STREAM_BYTES: usize = 700_000;

/// A fresh folder for the test of that name.
fn place(name: &str) -> PathBuf {
    let place = bench::place(name);
    if place.exists() {
        fs::remove_dir_all(&place).expect("what an earlier run left can be removed");
    }
    fs::create_dir_all(&place).expect("the place of the tests can be written");
    place
}

/// `platoon vcan shell` with these words, in that folder.
fn shell(place: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_platoon"));
    command.args(["vcan", "shell"]).args(words).current_dir(place).stdin(Stdio::null());
    command
}

/// Runs a shell script in the booted kernel.
fn script(name: &str, text: &str) -> Output {
    shell(&place(name), &["--", "sh", "-c", text]).output().expect("the command starts")
}

/// Starts a command and waits for the first line on its standard output.
fn started(command: &mut Command) -> (Child, BufReader<std::process::ChildStdout>) {
    let mut child = command.stdout(Stdio::piped()).spawn().expect("the command starts");
    let mut stdout = BufReader::new(child.stdout.take().expect("asked for"));
    let mut line = String::new();
    stdout.read_line(&mut line).expect("text");
    assert_eq!(line, "up\n");
    (child, stdout)
}

fn send(child: &Child, signal: Signal) {
    let pid = Pid::from_raw(child.id() as i32).expect("no process has number 0");
    kill_process(pid, signal).expect("a process of our own");
}

/// Processes whose command line names the kernel folder of the caller with this number.
fn family_of(caller: u32) -> Vec<String> {
    let mark = format!("platoon-kernel-{caller}-");
    let entries = fs::read_dir("/proc").expect("Linux has /proc").flatten();
    let lines = entries.filter_map(|entry| fs::read(entry.path().join("cmdline")).ok());
    lines
        .map(|line| String::from_utf8_lossy(&line).replace('\0', " "))
        .filter(|line| line.contains(&mark))
        .collect()
}

fn assert_nothing_left_of(caller: u32) {
    eventually("the end of the kernel's family", LIMIT, || {
        family_of(caller).is_empty().then_some(())
    });
    let folder = std::env::temp_dir().join(format!("platoon-kernel-{caller}-0"));
    eventually("the end of its folder", LIMIT, || (!folder.exists()).then_some(()));
}

/// Bytes of all values, in no order (a linear congruential generator of Numerical Recipes).
fn every_byte(seed: u32) -> Vec<u8> {
    let next = |state: &u32| Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let states = std::iter::successors(Some(seed), next);
    states.map(|state| (state >> 24) as u8).take(STREAM_BYTES).collect()
}

#[test]
#[ignore = "needs user-mode-linux"]
fn arguments_environment_folder_and_mask_arrive_as_they_are() {
    let place = place("shell-arguments");
    let words =
        ["--", "sh", "-c", "printf '%s|' \"$@\" \"$ODD\"; pwd; umask", "a b", "", "q\"'$x*"];
    let outside = "umask 027; exec \"$0\" \"$@\"";
    let output = Command::new("sh")
        .args(["-c", outside, env!("CARGO_BIN_EXE_platoon"), "vcan", "shell"])
        .args(words)
        .env("ODD", "two\nlines")
        .current_dir(&place)
        .output()
        .expect("the command starts");
    let expected = format!("|q\"'$x*|two\nlines|{}\n0027\n", place.display());
    assert_eq!(String::from_utf8_lossy(&output.stdout), expected, "{output:?}");
}

#[test]
#[ignore = "needs user-mode-linux"]
fn the_exit_status_is_the_commands() {
    assert_eq!(script("shell-status", "exit 7").status.code(), Some(7));
    assert_eq!(script("shell-killed", "kill -KILL $$").status.code(), Some(137));
}

#[test]
#[ignore = "needs user-mode-linux"]
fn a_command_that_cannot_be_run_is_answered_as_shells_do() {
    for (name, status) in [("no-such-command", 127), ("/etc/passwd", 126)] {
        let output = shell(&place("shell-no-command"), &["--", name]).output().expect("starts");
        assert_eq!(output.status.code(), Some(status), "{output:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(name), "{output:?}");
    }
}

#[test]
#[ignore = "needs user-mode-linux"]
fn streams_pass_byte_for_byte_and_apart() {
    let place = place("shell-streams");
    let (input, errors) = (every_byte(1), every_byte(2));
    fs::write(place.join("errors"), &errors).expect("a fresh folder");
    // Input is read late, so that it has to wait on the way.
    let words = ["--", "sh", "-c", "test -t 1; echo $?; cat errors >&2; sleep 1; cat"];
    let mut child = shell(&place, &words)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut stdin = child.stdin.take().expect("asked for");
    let to_send = input.clone();
    let sender = thread::spawn(move || stdin.write_all(&to_send).expect("everything is read"));
    let output = child.wait_with_output().expect("it ends");
    sender.join().expect("no panic");
    assert!(output.status.success(), "{:?}", output.status);
    assert!(output.stdout == [b"1\n", input.as_slice()].concat(), "{}", output.stdout.len());
    assert!(output.stderr == errors, "{}", output.stderr.len());
}

#[test]
#[ignore = "needs user-mode-linux"]
fn what_it_writes_here_is_here_afterwards() {
    let place = place("shell-files");
    let words = ["--", "sh", "-c", "mkdir made && head -c 300000 /dev/zero > made/file"];
    assert!(shell(&place, &words).status().expect("starts").success());
    assert_eq!(fs::metadata(place.join("made/file")).expect("it is here").len(), 300_000);
}

#[test]
#[ignore = "needs user-mode-linux"]
fn a_folder_among_those_it_has_of_its_own_is_there_all_the_same() {
    let place = Path::new("/dev/shm/platoon-shell-folder");
    fs::create_dir_all(place).expect("every Linux has /dev/shm");
    let output = shell(place, &["--", "sh", "-c", "pwd; echo made > file; ls /dev/shm"]).output();
    let output = output.expect("the command starts");
    let made = fs::read_to_string(place.join("file"));
    fs::remove_dir_all(place).expect("our own folder");
    let said = format!("{}\nplatoon-shell-folder\n", place.display());
    assert_eq!(String::from_utf8_lossy(&output.stdout), said, "{output:?}");
    assert_eq!(made.expect("it is on the host"), "made\n");
}

#[test]
#[ignore = "needs user-mode-linux"]
fn it_is_root_of_a_network_with_can_interfaces_that_are_ready() {
    let place = place("shell-interfaces");
    let check = "vcan check --names can-a,can-b";
    let inner = format!("{} {check}", env!("CARGO_BIN_EXE_platoon"));
    let words = ["--interfaces", "can-a,can-b", "--", "sh", "-c", &inner];
    let output = shell(&place, &words).output().expect("starts");
    assert!(output.status.success(), "{output:?}");
    let page = String::from_utf8_lossy(&output.stdout);
    assert_eq!(page.matches("vcan, MTU 72, up, quiet").count(), 2, "{page}");
}

#[test]
#[ignore = "needs user-mode-linux"]
fn an_interrupt_reaches_the_command_which_may_end_in_order() {
    let place = place("shell-interrupt");
    let text = "trap 'echo flushed > file; exit 5' INT; echo up; while :; do sleep 0.1; done";
    let (mut child, _) = started(&mut shell(&place, &["--", "sh", "-c", text]));
    send(&child, Signal::INT);
    assert_eq!(child.wait().expect("it ends").code(), Some(5));
    assert_eq!(fs::read_to_string(place.join("file")).expect("it is here"), "flushed\n");
    assert_nothing_left_of(child.id());
}

#[test]
#[ignore = "needs user-mode-linux"]
fn a_termination_ends_a_command_that_does_not_care() {
    let place = place("shell-terminate");
    let (mut child, _) =
        started(&mut shell(&place, &["--", "sh", "-c", "echo up; exec sleep 600"]));
    send(&child, Signal::TERM);
    assert_eq!(child.wait().expect("it ends").code(), Some(143));
    assert_nothing_left_of(child.id());
}

#[test]
#[ignore = "needs user-mode-linux"]
fn what_a_command_leaves_running_ends_with_it() {
    let output = script("shell-background", "sleep 600 & sh -c 'trap : TERM; sleep 600' & exit 3");
    assert_eq!(output.status.code(), Some(3), "{output:?}");
}

#[test]
#[ignore = "needs user-mode-linux"]
fn a_command_nobody_reads_learns_of_it() {
    let place = place("shell-pipe");
    let (mut child, stdout) = started(&mut shell(&place, &["--", "sh", "-c", "echo up; exec yes"]));
    drop(stdout);
    assert_eq!(child.wait().expect("it ends").code(), Some(128 + 13));
}

#[test]
#[ignore = "needs user-mode-linux"]
fn a_killed_caller_leaves_no_process_and_no_folder() {
    let place = place("shell-murder");
    let text = "echo up; echo kept > file; while :; do :; done";
    let (mut child, _) = started(&mut shell(&place, &["--", "sh", "-c", text]));
    assert!(!family_of(child.id()).is_empty(), "the kernel runs");
    send(&child, Signal::KILL);
    assert_eq!(child.wait().expect("it ends").signal(), Some(9));
    assert_nothing_left_of(child.id());
    assert_eq!(fs::read_to_string(place.join("file")).expect("it is here"), "kept\n");
}

#[test]
#[ignore = "needs user-mode-linux"]
fn it_ends_with_the_process_that_started_it() {
    let place = place("shell-orphan");
    let inner =
        format!("{} vcan shell -- sh -c 'echo up; sleep 600'; :", env!("CARGO_BIN_EXE_platoon"));
    let mut parent = Command::new("sh");
    parent.args(["-c", &inner]).current_dir(&place).stdin(Stdio::null());
    let (mut parent, mut stdout) = started(&mut parent);
    send(&parent, Signal::KILL);
    parent.wait().expect("it ends");
    // Every process that holds the other end must be gone before this returns.
    let mut rest = Vec::new();
    stdout.read_to_end(&mut rest).expect("it ends");
    assert!(rest.is_empty(), "{rest:?}");
}

#[test]
#[ignore = "needs user-mode-linux"]
fn on_a_terminal_it_has_one_of_the_same_size_and_keys() {
    let place = place("shell-terminal");
    let text = "stty size; test -t 0 && test -t 1 && test -t 2; echo $?; read word; \
                echo \"<$word>\"; trap 'echo int; exit 4' INT; echo up; \
                while :; do sleep 0.1; done";
    fs::write(place.join("script"), text).expect("a fresh folder");
    let inner =
        format!("stty rows 31 cols 97; {} vcan shell -- sh script", env!("CARGO_BIN_EXE_platoon"));
    let mut terminal = Command::new("script")
        .args(["-qec", &inner, "/dev/null"])
        .current_dir(&place)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("script(1) of util-linux");
    let mut keys = terminal.stdin.take().expect("asked for");
    let mut screen = BufReader::new(terminal.stdout.take().expect("asked for"));
    keys.write_all(b"yes\r").expect("it is read");
    let mut shown = String::new();
    while !shown.contains("up\r\n") {
        assert_ne!(screen.read_line(&mut shown).expect("text"), 0, "{shown:?}");
    }
    // Ctrl-C.
    keys.write_all(b"\x03").expect("it is read");
    screen.read_to_string(&mut shown).expect("text");
    assert!(shown.contains("31 97\r\n0\r\n"), "{shown:?}");
    assert!(shown.contains("<yes>\r\n"), "{shown:?}");
    assert!(shown.contains("int\r\n"), "{shown:?}");
    assert_eq!(terminal.wait().expect("it ends").code(), Some(4));
}

#[test]
#[ignore = "needs user-mode-linux"]
fn a_kernel_without_memory_says_so() {
    let place = place("shell-memory");
    let output =
        shell(&place, &["--memory-mb", "128", "--", "tail", "/dev/zero"]).output().expect("starts");
    assert_eq!(output.status.code(), Some(137), "{output:?}");
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(words.contains("out of memory") && words.contains("--memory-mb"), "{words}");
}

#[test]
#[ignore = "needs user-mode-linux"]
fn an_interface_that_cannot_be_made_is_refused_before_the_command() {
    let place = place("shell-bad-interface");
    let words = ["--interfaces", "a/b", "--", "sh", "-c", "echo ran > file"];
    let output = shell(&place, &words).output().expect("starts");
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("a/b"), "{output:?}");
    assert!(!place.join("file").exists());
}

/// A program that answers like a kernel and does not boot.
fn broken_kernel(place: &Path) -> String {
    let path = place.join("linux");
    let text = "#!/bin/sh\n\
                case $1 in\n\
                --version) echo 6.1.0 ;;\n\
                --showconfig) printf 'CONFIG_CAN=y\\nCONFIG_CAN_RAW=y\\nCONFIG_CAN_VCAN=y\\n' ;;\n\
                *) echo 'Kernel panic - no good'; exit 1 ;;\n\
                esac\n";
    let mut file = File::create(&path).expect("a fresh folder");
    file.write_all(text.as_bytes()).expect("room for it");
    file.set_permissions(fs::Permissions::from_mode(0o755)).expect("our own file");
    path.to_str().expect("UTF-8").to_owned()
}

#[test]
fn a_kernel_that_does_not_boot_is_refused_with_its_last_words() {
    let place = place("shell-broken-kernel");
    let output = shell(&place, &["--uml", &broken_kernel(&place), "--", "true"]).output();
    let output = output.expect("the command starts");
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(words.contains("does not boot") && words.contains("no good"), "{words}");
}

#[test]
fn what_is_not_there_is_refused_by_name() {
    let place = place("shell-missing");
    let kernel = broken_kernel(&place);
    let refused: [(&[&str], i32, &str); 5] = [
        (&["--uml", "/nosuch", "--", "true"], 3, "/nosuch"),
        (&["--uml", &kernel, "--modules", "/nosuch", "--", "true"], 3, "/nosuch"),
        (&["--uml", &kernel, "--memory-mb", "1048576", "--", "true"], 3, "--memory-mb"),
        (&["--uml", &kernel, "--memory-mb", "1", "--", "true"], 2, "--memory-mb"),
        (&[], 2, "vcan shell -- CMD"),
    ];
    for (words, code, name) in refused {
        let output = shell(&place, words).output().expect("starts");
        assert_eq!(output.status.code(), Some(code), "{words:?}: {output:?}");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(stderr.contains(name), "{words:?}: {stderr}");
    }
}
