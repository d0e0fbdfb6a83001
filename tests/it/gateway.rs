//! Socketcand clients at a run: a whole crowd of them, not all well behaved, harms nothing.

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use crate::bench::{self, Ongoing};

const LIMIT: Duration = Duration::from_secs(120);
/// How many attach at once.
const CROWD: usize = 20;

/// Where the gateway of a run says it is.
fn gateway_of(run: &Ongoing) -> String {
    bench::eventually("the gateway's address", LIMIT, || {
        let words = fs::read_to_string(run.out().with_file_name("stderr")).ok()?;
        let line = words.lines().find(|line| line.starts_with("socketcand clients may attach"))?;
        line.split_whitespace().last().map(str::to_owned)
    })
}

fn attach(address: &str, said: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("the gateway listens");
    stream.set_read_timeout(Some(LIMIT)).expect("a socket option");
    stream.write_all(said.as_bytes()).expect("connected");
    stream
}

/// Reads until these words have come.
fn wait_for(stream: &mut TcpStream, words: &str) {
    let (mut heard, mut bytes) = (String::new(), [0; 1024]);
    while !heard.contains(words) {
        let count = stream.read(&mut bytes).expect("an answer in time");
        assert!(count > 0, "closed after {heard:?}");
        heard.push_str(std::str::from_utf8(&bytes[..count]).expect("ASCII"));
    }
}

#[test]
fn a_crowd_of_clients_does_not_disturb_a_run() {
    let arguments = ["--bus", "udp", "--rate-hz", "100", "--duration-s", "5", "--socketcand", "0"];
    let ongoing = bench::start_rehearsal("gateway-crowd", &arguments);
    let address = gateway_of(&ongoing);
    let mut crowd: Vec<TcpStream> = (0..CROWD)
        .map(|number| attach(&address, &format!("< open truck{} >< rawmode >", number % 4)))
        .collect();
    for client in &mut crowd {
        wait_for(client, "< frame 18FF1080 ");
    }
    drop(crowd.drain(..CROWD / 2));
    let mut rude = attach(&address, &format!("< open truck0 >< send {} ", "x".repeat(100_000)));
    wait_for(&mut rude, "< error command too long >");
    rude.write_all(b"< send 1 >< nonsense >< send 7FF 0 >< echo >").expect("connected");
    wait_for(&mut rude, "< echo >");
    let run = ongoing.finish(LIMIT);
    assert!(matches!(run.code(), Some(0 | 1)), "{:?}: {}", run.code(), run.stderr);
    let summary = run.summary();
    assert!((summary.duration_s - 5.0).abs() < 1e-6, "ended at {} s", summary.duration_s);
    let unknown: Vec<u64> = summary.nodes.iter().map(|node| node.unknown).collect();
    assert_eq!(unknown, [1, 0, 0, 0]);
    for node in &summary.nodes {
        assert_eq!((node.malformed, node.bad_crc, node.missing, node.unechoed), (0, 0, 0, 0));
    }
    let noted = summary.notes.iter().find(|note| note.starts_with("socketcand: 21 clients"));
    let noted = noted.unwrap_or_else(|| panic!("{:?}", summary.notes));
    assert!(noted.contains("1 from them") && noted.contains("3 malformed commands"), "{noted}");
}

#[test]
fn a_busy_gateway_port_is_refused_by_number() {
    let holder = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = holder.local_addr().expect("bound").port().to_string();
    let run = bench::rehearse("gateway-port", &["--bus", "udp", "--socketcand", &port]);
    run.expect_code(3);
    let line = run.stderr.lines().next().unwrap_or_default();
    assert!(line.contains(&format!("--socketcand 127.0.0.1:{port}")), "{line}");
    assert!(line.contains("choose another") && !run.out().exists(), "{line}");
}
