//! `liveview view` of a scene of photos.

use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::json;

use crate::common::viewer::{Viewer, moved};
use crate::common::{Folders, fixture};

#[test]
fn picture_at_full_quality_equals_that_of_render() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--target", "2", "--layers", "surface:1"]);
    let info = viewer.description();
    assert_eq!((info["views"].as_array().unwrap().len(), &info["views"][2]["held_out"]), (5, &true.into()));
    let camera = moved(&info, 2, 0.037);
    let (status, saved) = viewer.picture(&json!({ "camera": camera }));
    let (pose, picture) = (folders.out("pose.json"), folders.out("pose.png"));
    fs::write(&pose, camera.to_string()).unwrap();
    folders.render(&["--pose", &pose, "--holdout", "2", "--layers", "surface:1", "-o", &picture]).assert().success();
    assert!(status == 200 && saved == fs::read(&picture).unwrap());

    let mut large = camera.clone();
    large["w"] = 16384.into();
    for (body, status, word) in [
        (json!({ "camera": { "cam_from_world": 3 } }), 400, "3 or 4 rows of 4 numbers"),
        (json!({ "camera": large }), 400, "larger than the photos"),
        (json!({ "camera": camera, "step": 1 }), 400, "step: expected a time step from 0 to 0"),
        (json!({}), 400, "cam_from_world"),
    ] {
        let (found, reason) = viewer.picture(&body);
        let reason = String::from_utf8_lossy(&reason).into_owned();
        assert!(found == status && reason.contains(word), "{found} {reason}");
    }
    assert_eq!(viewer.ask("POST /picture", &[], "{").0, 400);
    assert_eq!(viewer.ask("POST /picture", &[], &"x".repeat(5000)).0, 413);
    let (code, printed) = viewer.end();
    assert_eq!((code, printed.as_str()), (Some(0), "1 pictures for 1 viewer\n"));
}

#[test]
fn a_failed_picture_is_one_clients_error_and_names_no_path() {
    let folders = Folders::new();
    let mut viewer = Viewer::start(&folders, &["--layers", "surface:1"]);
    let info = viewer.description();
    let mut behind = moved(&info, 2, 0.0);
    behind["cam_from_world"] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
    let mut tiny = moved(&info, 2, 0.0);
    (tiny["fl_x"], tiny["fl_y"], tiny["cx"], tiny["cy"]) = (1e-308.into(), 1e-308.into(), 0.into(), 0.into());
    let (status, reason) = viewer.picture(&json!({ "camera": behind }));
    assert_eq!((status, &reason[..]), (500, &b"failed; `liveview view` has printed why\n"[..]));
    // Whatever becomes of this one, the next is served.
    viewer.picture(&json!({ "camera": tiny }));
    assert!(viewer.lines.next().unwrap().starts_with("note: the picture failed: "));
    assert_eq!(viewer.picture(&json!({ "camera": moved(&info, 2, 0.0) })).0, 200);
    fs::write(folders.photo(3), b"damaged").unwrap();
    let (status, reason) = viewer.ask("GET /photo/3", &[], "");
    let reason = String::from_utf8_lossy(&reason).into_owned();
    assert!(status == 500 && reason == "failed; `liveview view` has printed why\n", "{status} {reason}");
}

#[test]
fn depth_is_sent_once_it_is_found_and_stays_the_same() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--target", "2", "--layers", "surface:1"]);
    // More clients than one, each for all photos at once.
    let answers: Vec<_> = std::thread::scope(|scope| {
        let viewer = &viewer;
        let ask = |i: usize| scope.spawn(move || viewer.ask(&format!("GET /depth/{}", [4, 0, 3, 1][i % 4]), &[], ""));
        let asked: Vec<_> = (0..12).map(ask).collect();
        asked.into_iter().map(|one| one.join().unwrap()).collect()
    });
    assert!(answers.iter().all(|(status, depth)| *status == 200 && depth.len() > 100));
    assert!((4..12).all(|i| answers[i].1 == answers[i - 4].1));
    assert_eq!(viewer.status("GET /depth/2", &[]), 404, "a held-out photo");
    for (path, kind) in [("/", "text/html"), ("/photo/0", "image/jpeg"), ("/depth/0", "application/octet-stream")] {
        let (_, answer) = viewer.ask_whole(&format!("GET {path}"));
        assert!(answer.contains(&format!("content-type: {kind}")), "{answer}");
        assert!(answer.contains("content-security-policy: frame-ancestors 'none'") && answer.contains("nosniff"));
    }
}

#[test]
fn requests_of_other_pages_are_refused() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let own = format!("http://{}", viewer.host);
    assert!(viewer.host.starts_with("127.0.0.1:"));
    for path in ["/", "/photo/0"] {
        assert_eq!(viewer.status(&format!("GET {path}"), &[("Origin", &own)]), 200, "{path}");
    }
    for path in ["/photo/5", "/photo/x", "/depth/5", "/page/view.js", "/photo/..%2f0"] {
        assert!((400..405).contains(&viewer.status(&format!("GET {path}"), &[])), "{path}");
    }
    for headers in [("Host", "evil.example"), ("Origin", "http://evil.example"), ("Sec-Fetch-Site", "cross-site")] {
        for request in ["GET /", "GET /photo/0", "POST /picture", "GET /depth/0"] {
            assert_eq!(viewer.status(request, &[headers]), 403, "{request} {headers:?}");
        }
    }
    assert_eq!(viewer.status("GET /", &[("Origin", "null")]), 403);
}

#[test]
fn with_bind_or_origin_the_token_of_the_link_is_required() {
    let folders = Folders::new();
    let front = "https://front.example";
    for option in [["--bind", "127.0.0.1"], ["--origin", front]] {
        let viewer = Viewer::start(&folders, &[&["--layers", "guided:1"][..], &option].concat());
        assert!(viewer.query.starts_with("?token="));
        for request in ["GET /", "GET /photo/0", "POST /picture", "GET /depth/0", "GET /photo/9"] {
            for query in
                ["", "?token=", "?token=00", &format!("{}0", viewer.query), &viewer.query.replace("token", "other")]
            {
                assert_eq!(viewer.status(&format!("{request}{query}"), &[]), 403, "{request}{query}");
            }
        }
        for path in ["/", "/photo/0"] {
            assert_eq!(viewer.status(&format!("GET {path}{}", viewer.query), &[]), 200);
        }
        // A picture needs a camera.
        assert_eq!(viewer.status(&format!("POST /picture{}", viewer.query), &[]), 400);
        let from = |origin| viewer.status(&format!("GET /{}", viewer.query), &[("Origin", origin)]);
        assert_eq!(from("http://evil.example"), 403);
        assert_eq!(from(front), if option[0] == "--origin" { 200 } else { 403 });
    }
    // The link names an address of this machine, not the one that stands for all of them.
    let everywhere = Viewer::start(&folders, &["--layers", "guided:1", "--bind", "0.0.0.0"]);
    assert!(!everywhere.host.starts_with("0.0.0.0"), "{}", everywhere.host);
    assert_eq!(everywhere.status(&format!("GET /{}", everywhere.query), &[]), 200);
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
