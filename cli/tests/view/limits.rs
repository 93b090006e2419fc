//! `liveview view`: clients that are slow, send too much, or open too many connections.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use crate::common::Folders;
use crate::common::viewer::{PATIENCE, Viewer};

/// The answer to raw bytes, until the connection is closed.
fn raw(mut stream: TcpStream, sent: &str) -> String {
    // It may be closed before all is sent.
    let _ = stream.write_all(sent.as_bytes());
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn large_heads_and_slow_requests_are_refused() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1", "--bind", "127.0.0.1"]);
    let head = format!("GET /{} HTTP/1.1\r\nHost: {}\r\n", viewer.query, viewer.host);
    assert!(raw(viewer.stream(), &format!("{head}Connection: close\r\n\r\n")).starts_with("HTTP/1.1 200"));
    let long = format!("{head}X-Long: {}\r\n\r\n", "x".repeat(20_000));
    let many: String = (0..70).map(|i| format!("X-{i}: 1\r\n")).collect();
    for head in [long, format!("{head}{many}\r\n")] {
        assert!(raw(viewer.stream(), &head).starts_with("HTTP/1.1 431"));
    }
    let body =
        format!("POST /picture{} HTTP/1.1\r\nHost: {}\r\nContent-Length: 100\r\n\r\n{{", viewer.query, viewer.host);
    // Half a head, no byte at all, half a body, and a second request that never comes.
    let began = Instant::now();
    std::thread::scope(|scope| {
        let [half, nothing, body, idle] = [head.clone(), String::new(), body, format!("{head}\r\n")].map(|sent| {
            let stream = viewer.stream();
            scope.spawn(move || raw(stream, &sent))
        });
        assert_eq!(viewer.status(&format!("GET /photo/0{}", viewer.query), &[]), 200);
        let answers = [half, nothing, body, idle].map(|slow| slow.join().unwrap());
        assert!(answers[0].is_empty() || answers[0].starts_with("HTTP/1.1 408"), "{}", answers[0]);
        assert_eq!(answers[1], "");
        assert!(answers[2].starts_with("HTTP/1.1 408"), "{}", answers[2]);
        assert!(answers[3].starts_with("HTTP/1.1 200"), "{}", answers[3]);
    });
    assert!(began.elapsed() < PATIENCE, "{:?}", began.elapsed());
}

#[test]
fn idle_connections_do_not_lock_out_their_address() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let idle: Vec<TcpStream> = (0..250).map(|_| viewer.stream()).collect();
    let began = Instant::now();
    assert_eq!(viewer.status("GET /photo/1", &[]), 200);
    assert!(began.elapsed() < Duration::from_secs(3), "{:?}", began.elapsed());
    drop(idle);
}
