//! Hostile requests to the viewer, by seed: each is answered or its connection closed, and the viewer lives.

use std::io::{Read, Write};

use crate::attack_count;
use crate::attacks::change_json;
use crate::common::Folders;
use crate::common::viewer::{Viewer, moved};
use crate::scene::Random;

/// A request, but for its head's last lines.
fn request(random: &mut Random, camera: &serde_json::Value, viewer: &Viewer) -> Vec<u8> {
    let (query, host) = (&viewer.query, &viewer.host);
    let long = "x".repeat(9000);
    let paths = [
        "/",
        "/photo/0",
        "/photo/1?",
        "/depth/0",
        "/photo/-1",
        "/photo/99999999999999999999",
        "/depth/3",
        "/depth/9",
        "/depth/%00",
        "/picture",
        "//etc/passwd",
        "/../../etc/passwd",
        "/photo/..%2f..%2fetc%2fpasswd",
        "/photo/0/0",
        "*",
        "",
        "http://other/",
        "/%ff%fe",
        &long,
    ];
    let path = *random.of(&paths);
    let queries = [query.as_str(), "", "?token=", "?a=b&&&", "?step=-1", "?step=1e308"];
    let query_given = *random.of(&queries);
    let headers = [
        "Connection: close",
        "Host: other",
        "Origin: http://evil.example",
        "Content-Length: -1",
        "Content-Length: 18446744073709551616",
        "Transfer-Encoding: chunked",
        "Range: bytes=9-1",
        "Accept-Encoding: \u{1}",
        "X: \r\n folded",
        "Upgrade: h2c",
        "Expect: 100-continue",
        ":",
        "\0: \0",
    ];
    let header = *random.of(&headers);
    let common = format!("Host: {host}\r\nConnection: close\r\n");
    match random.below(8) {
        0 => (0..random.below(400)).map(|_| random.below(256) as u8).collect(),
        1 => {
            let method = *random.of(&["GET", "POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "get", "PRI", "\0"]);
            format!("{method} {path}{query_given} HTTP/1.1\r\n{common}\r\n").into_bytes()
        }
        2 => format!("GET {path}{query} HTTP/1.1\r\n{common}{header}\r\n\r\n").into_bytes(),
        3 => {
            let (path, version) =
                (*random.of(&["/", "/photo/1", "/depth/0"]), *random.of(&["1.1", "1.0", "2", "9.9", ""]));
            format!("GET {path}{query} HTTP/{version}\r\n{common}\r\n").into_bytes()
        }
        _ => {
            let mut body = change_json(&serde_json::to_string_pretty(camera).unwrap(), random).0.into_bytes();
            match random.below(6) {
                0 => body.truncate(random.below(body.len())),
                1 => {
                    let at = random.below(body.len());
                    body[at] ^= 1 << random.below(8);
                }
                _ => {}
            }
            let head = format!("POST /picture{query} HTTP/1.1\r\n{common}Content-Length: {}\r\n\r\n", body.len());
            [head.into_bytes(), body].concat()
        }
    }
}

#[test]
fn hostile_requests_are_answered_and_the_viewer_lives() {
    let folders = Folders::new();
    let mut viewer = Viewer::start(&folders, &["--layers", "guided:1", "--threads", "1"]);
    let camera = serde_json::json!({ "camera": moved(&viewer.description(), 2, 0.01), "step": 0 });
    // Read all along: a full pipe would stop it.
    let lines = std::mem::replace(&mut viewer.lines, Box::new(std::iter::empty()));
    let printed = std::thread::spawn(|| lines.collect::<Vec<_>>().join("\n"));
    let requests = attack_count() / 4;
    let mut counts = [0_u64; 3];
    for seed in 0..requests {
        let request = request(&mut Random::new(seed), &camera, &viewer);
        let what = || format!("seed {seed}, {:?}", String::from_utf8_lossy(&request));
        let mut stream = viewer.stream();
        let (mut answer, _) = (Vec::new(), stream.write_all(&request));
        let _ = stream.shutdown(std::net::Shutdown::Write);
        let _ = stream.read_to_end(&mut answer);
        let text = String::from_utf8_lossy(&answer);
        let kind = match answer.get(9..12).and_then(|status| std::str::from_utf8(status).ok()?.parse().ok()) {
            Some(200..=399) => 0,
            Some(400..=499 | 501 | 503 | 505) => 1,
            // A camera that sees nothing.
            Some(500) if text.contains("failed; `liveview view` has printed why") => 1,
            None if answer.is_empty() => 2,
            status => panic!("{}: {status:?}: {text}", what()),
        };
        counts[kind] += 1;
        let root = folders.scene();
        assert!(kind == 0 || !text.contains(root.to_str().unwrap()), "{}: names a path: {text}", what());
        if seed % 25 == 0 {
            assert_eq!(viewer.picture(&camera).0, 200, "after {}", what());
        }
    }
    println!("{requests} requests: {} answered, {} refused, {} closed", counts[0], counts[1], counts[2]);
    assert!(requests < 40 || counts[0] > 0 && counts[1] > 0, "{counts:?}");
    let (code, summary) = viewer.end();
    let printed = printed.join().unwrap();
    assert!(code == Some(0) && !printed.contains("panicked"), "{code:?}: {printed}\n{summary}");
}
