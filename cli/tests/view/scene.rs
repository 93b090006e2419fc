//! `liveview view` of a scene of photos: the server and its messages.

use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::Message;
use tungstenite::protocol::frame::coding::CloseCode;

use crate::common::viewer::{Viewer, moved};
use crate::common::{Folders, fixture};

#[test]
fn picture_at_rest_equals_that_of_render() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &[]);
    let (mut client, info) = viewer.client();
    assert_eq!(info["views"].as_array().unwrap().len(), 5);
    let camera = moved(&info, 2, 0.037);

    client.request(1, &camera, true);
    let (header, picture) = client.frame();
    assert_eq!((&header["id"], &header["moving"], &header["layers"]), (&1.into(), &true.into(), &"guided:1".into()));
    assert_eq!(picture[..2], [0xFF, 0xD8], "JPEG");

    client.request(2, &camera, false);
    let (header, shown) = client.frame();
    assert_eq!((&header["id"], &header["width"], &header["layers"]), (&2.into(), &64.into(), &"guided:2".into()));
    let (status, saved) =
        viewer.ask(&format!("POST /picture{}", viewer.query), &[], &json!({ "camera": camera }).to_string());
    assert_eq!(status, 200);
    let (pose, picture) = (folders.out("pose.json"), folders.out("pose.png"));
    fs::write(&pose, camera.to_string()).unwrap();
    folders.render(&["--pose", &pose, "-o", &picture]).assert().success();
    let rendered = fs::read(&picture).unwrap();
    assert!(shown == rendered && saved == rendered);

    // A camera that was not shown yet is rendered; an invalid one is refused.
    let (status, other) = viewer.ask("POST /picture", &[], &json!({ "camera": moved(&info, 1, 0.0) }).to_string());
    assert!(status == 200 && other != rendered);
    let (status, reason) = viewer.ask("POST /picture", &[], r#"{"camera": {"cam_from_world": 3}}"#);
    assert!(status == 400 && String::from_utf8_lossy(&reason).contains("3 or 4 rows of 4 numbers"));
    assert_eq!(viewer.ask("POST /picture", &[], &"x".repeat(5000)).0, 413);

    drop(client);
    let (code, printed) = viewer.end();
    assert_eq!((code, printed.as_str()), (Some(0), "3 pictures for 1 viewer\n"));
}

#[test]
fn newest_request_of_each_client_is_served() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let ((mut one, info), (mut two, _)) = (viewer.client(), viewer.client());
    // As many frames as are sent to a client that shows none.
    for id in [1, 2] {
        one.request(id, &moved(&info, 2, 0.01 * id as f64), true);
        assert_eq!(one.frame().0["id"], id);
    }
    (3..=60).for_each(|id| one.request(id, &moved(&info, 2, 0.001 * id as f64), true));
    // The other client is served meanwhile.
    two.request(7, &moved(&info, 1, 0.01), false);
    assert_eq!(two.frame().0["id"], 7);
    one.send(&json!({ "shown": 1 }));
    assert_eq!(one.frame().0["id"], 60);
    // A request that fails is answered with an error, and the next one is served.
    let mut behind = moved(&info, 2, 0.0);
    behind["cam_from_world"] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
    two.request(8, &behind, false);
    assert!(two.text()["error"].as_str().unwrap().contains("face the target's direction"));
    two.request(9, &moved(&info, 2, 0.0), false);
    assert_eq!(two.frame().0["id"], 9);
    // The end of the program is sent to each client.
    let ended = std::thread::spawn(move || viewer.end().0);
    assert_eq!(two.closed(), (CloseCode::Away, "the program has ended".to_owned()));
    assert_eq!(one.closed().0, CloseCode::Away);
    drop((one, two));
    assert_eq!(ended.join().unwrap(), Some(0));
}

#[test]
fn requests_of_other_pages_are_refused() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let own = format!("http://{}", viewer.host);
    assert!(viewer.host.starts_with("127.0.0.1:"));
    for path in ["/", "/page/view.js", "/page/view.css", "/photo/0"] {
        assert_eq!(viewer.status(&format!("GET {path}"), &[("Origin", &own)]), 200, "{path}");
    }
    for path in ["/photo/5", "/photo/x", "/page/other.js", "/page/..%2fmod.rs"] {
        assert!((400..405).contains(&viewer.status(&format!("GET {path}"), &[])), "{path}");
    }
    for headers in [("Host", "evil.example"), ("Origin", "http://evil.example"), ("Sec-Fetch-Site", "cross-site")] {
        for request in ["GET /", "GET /photo/0", "POST /picture", "GET /socket"] {
            assert_eq!(viewer.status(request, &[headers]), 403, "{request} {headers:?}");
        }
    }
    assert_eq!(viewer.open(&[("Origin", "http://evil.example")]).err(), Some(403));
    assert_eq!(viewer.open(&[("Origin", "null")]).err(), Some(403));
    assert_eq!(viewer.open(&[("Host", "evil.example")]).err(), Some(403));
    assert!(viewer.open(&[]).is_ok(), "a client that is no browser");
}

#[test]
fn with_bind_the_token_of_the_link_is_required() {
    let folders = Folders::new();
    let mut viewer = Viewer::start(&folders, &["--layers", "guided:1", "--bind", "127.0.0.1"]);
    assert!(viewer.query.starts_with("?token="));
    for request in ["GET /", "GET /photo/0", "POST /picture", "GET /socket", "GET /photo/9"] {
        for query in
            ["", "?token=", "?token=00", &format!("{}0", viewer.query), &viewer.query.replace("token", "other")]
        {
            assert_eq!(viewer.status(&format!("{request}{query}"), &[]), 403, "{request}{query}");
        }
    }
    for path in ["/", "/photo/0"] {
        assert_eq!(viewer.status(&format!("GET {path}{}", viewer.query), &[]), 200);
    }
    // A picture needs a camera, and the socket an upgrade.
    assert_eq!(viewer.status(&format!("POST /picture{}", viewer.query), &[]), 400);
    assert_eq!(viewer.status(&format!("GET /socket{}", viewer.query), &[]), 400);
    let origin = ("Origin", "http://evil.example");
    assert_eq!(viewer.status(&format!("GET /{}", viewer.query), &[origin]), 403);
    viewer.client();
    viewer.query.clear();
    assert_eq!(viewer.open(&[]).err(), Some(403));
    // The link names an address of this machine, not the one that stands for all of them.
    let everywhere = Viewer::start(&folders, &["--layers", "guided:1", "--bind", "0.0.0.0"]);
    assert!(!everywhere.host.starts_with("0.0.0.0"), "{}", everywhere.host);
    assert_eq!(everywhere.status(&format!("GET /{}", everywhere.query), &[]), 200);
}

#[test]
fn invalid_message_closes_only_its_connection_and_says_why() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let (mut good, info) = viewer.client();
    let mut large = moved(&info, 2, 0.0);
    large["w"] = 16384.into();
    let large = json!({ "id": 1, "moving": false, "depth": false, "camera": large }).to_string();
    for (message, code, word) in [
        (Message::text("{"), CloseCode::Policy, "not JSON"),
        (Message::text(r#"{"delete": "all"}"#), CloseCode::Policy, "expected \"camera\" or \"shown\""),
        (Message::text(large), CloseCode::Policy, "larger than the photos"),
        (Message::text("x".repeat(4097)), CloseCode::Size, "4097 bytes; expected at most 4096"),
        (Message::binary(vec![0; 8]), CloseCode::Unsupported, "expected text"),
        (Message::text("x".repeat(100_000)), CloseCode::Protocol, "too long"),
    ] {
        let (mut client, _) = viewer.client();
        client.socket.send(message).unwrap();
        let (closed, reason) = client.closed();
        assert!(closed == code && reason.contains(word), "{closed} {reason}");
    }
    let (mut client, _) = viewer.client();
    (0..1000).for_each(|_| drop(client.socket.send(Message::text(r#"{"shown": 1}"#))));
    assert_eq!(client.closed(), (CloseCode::Policy, "too many messages a second".to_owned()));
    good.request(1, &moved(&info, 2, 0.0), true);
    assert_eq!(good.frame().0["id"], 1);
}

#[test]
fn held_out_photo_is_scored_and_not_rendered_from() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--target", "2", "--layers", "surface:1"]);
    let (mut client, info) = viewer.client();
    assert_eq!(info["views"][2]["held_out"], true);
    client.request(1, &moved(&info, 2, 0.0), false);
    let (header, picture) = client.rested();
    assert!(!header["views"].as_array().unwrap().contains(&2.into()));
    let target = folders.out("target.png");
    let report = folders.render(&["--target", "2", "--layers", "surface:1", "-o", &target, "--json"]).output().unwrap();
    let report: Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!((&header["truth"], &header["psnr"]), (&2.into(), &report["targets"][0]["psnr"]));
    assert!(header["psnr"].as_f64().unwrap() > 10.0 && picture == fs::read(&target).unwrap());
    client.request(2, &moved(&info, 2, 0.001), false);
    assert_eq!(client.rested().0["psnr"], Value::Null);
    // What is saved waits for the depth too; render holds the same photo out.
    let camera = moved(&info, 1, 0.4);
    let (status, saved) = viewer.ask("POST /picture", &[], &json!({ "camera": camera }).to_string());
    let (pose, picture) = (folders.out("pose.json"), folders.out("pose.png"));
    fs::write(&pose, camera.to_string()).unwrap();
    let arguments = ["--pose", &pose, "--holdout", "2", "--layers", "surface:1", "-o", &picture];
    folders.render(&arguments).assert().success();
    assert!(status == 200 && saved == fs::read(&picture).unwrap());
}

#[test]
fn options_that_cannot_work_are_refused_at_start() {
    let folders = Folders::new();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let model = fixture("tiny_v4");
    let refused = |arguments: &[&str], words: &[&str]| {
        let arguments = [&["--model", &model], arguments].concat();
        folders.assert_refused(&mut folders.liveview("view", &arguments), words);
    };
    refused(&["--port", &port], &[&port, "expected a free port (--port 0: any)"]);
    refused(&["--port", "0", "--heldout", "1"], &["--heldout 1", "expected 2 or more"]);
    refused(&["--port", "0", "--target", "7"], &["7"]);
    refused(&["--port", "0", "--heldout", "2"], &["4 views are needed"]);
}

/// A folder for the PATH, with programs of these names that write their arguments into a file; and
/// that file.
fn browsers(folders: &Folders, names: &[&str]) -> (String, PathBuf) {
    let (path, opened) = (folders.scene().join("bin"), folders.scene().join("opened"));
    fs::create_dir_all(&path).unwrap();
    for name in names {
        let file = path.join(name);
        fs::write(&file, format!("#!/bin/sh\necho \"$@\" > '{0}.part'\n/bin/mv '{0}.part' '{0}'\n", opened.display()))
            .unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).unwrap();
    }
    (path.to_str().unwrap().to_owned(), opened)
}

#[test]
#[cfg(target_os = "linux")]
fn open_starts_the_browser_or_prints_a_note() {
    let folders = Folders::new();
    for (arguments, names) in [(&["--open"][..], &["xdg-open"][..]), (&["--open"], &[]), (&[], &["xdg-open"])] {
        let arguments = [&["--layers", "guided:1", "--bind", "127.0.0.1"], arguments].concat();
        let (path, opened) = browsers(&folders, names);
        let mut viewer = Viewer::start_with(&folders, &arguments, |command| {
            command.env("PATH", &path);
        });
        let link = format!("http://{}/{}", viewer.host, viewer.query);
        match (arguments.len(), names.len()) {
            (5, 1) => {
                while !opened.exists() {
                    std::thread::sleep(Duration::from_millis(10));
                }
                assert_eq!(fs::read_to_string(&opened).unwrap().trim(), link);
                fs::remove_file(&opened).unwrap();
            }
            (5, _) => {
                let note = viewer.lines.next().unwrap();
                assert!(note.starts_with("note: --open: no browser could be started"), "{note}");
            }
            _ => assert!(!opened.exists()),
        }
        // The server runs in each case.
        assert_eq!(viewer.status(&format!("GET /{}", viewer.query), &[]), 200);
        fs::remove_dir_all(path).unwrap();
    }
}
