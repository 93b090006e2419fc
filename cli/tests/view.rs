//! `liveview view`: its server, over sockets of its own.

mod common;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use common::{Folders, fixture};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::{Message, WebSocket};

/// Longer than anything takes, so that a test fails and does not hang.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running viewer of the tiny scene.
struct Viewer {
    child: Child,
    host: String,
    query: String,
}

impl Viewer {
    fn start(folders: &Folders, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_liveview"));
        command.arg("view").arg(folders.scene()).args(["--port", "0", "--model", &fixture("tiny_v4")]).args(arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        let link = lines.inspect(|line| eprintln!("{line}")).find(|line| line.starts_with("open: ")).expect("a link");
        let (host, query) = link["open: http://".len()..].split_once('/').unwrap();
        let query = query.split_whitespace().next().filter(|query| query.starts_with('?')).unwrap_or_default();
        Self { child, host: host.to_owned(), query: query.to_owned() }
    }

    fn stream(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Status and body of a request with these headers; `Host` is the viewer's unless they name one.
    fn ask(&self, first: &str, headers: &[(&str, &str)], body: &str) -> (u16, Vec<u8>) {
        let host = ("Host", self.host.as_str());
        let named = headers.iter().any(|(name, _)| *name == "Host");
        let headers =
            headers.iter().chain((!named).then_some(&host)).map(|(name, value)| format!("{name}: {value}\r\n"));
        let head = format!("{first} HTTP/1.1\r\n{}Content-Length: {}\r\n", headers.collect::<String>(), body.len());
        let mut stream = self.stream();
        stream.write_all(format!("{head}Connection: close\r\n\r\n{body}").as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n").unwrap();
        let status = std::str::from_utf8(&answer[9..12]).unwrap().parse().unwrap();
        (status, answer.split_off(end + 4))
    }

    fn status(&self, first: &str, headers: &[(&str, &str)]) -> u16 {
        self.ask(first, headers, "").0
    }

    /// A client, or the status with which it was refused.
    fn open(&self, headers: &[(&'static str, &str)]) -> Result<Client, u16> {
        let mut request = format!("ws://{}/socket{}", self.host, self.query).into_client_request().unwrap();
        for (name, value) in headers {
            request.headers_mut().insert(*name, value.parse().unwrap());
        }
        match tungstenite::client(request, self.stream()) {
            Ok((socket, _)) => Ok(Client { socket }),
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// A client that was told of the scene.
    fn client(&self) -> (Client, Value) {
        let mut client = self.open(&[("Origin", &format!("http://{}", self.host))]).unwrap();
        let hello = client.text();
        (client, hello)
    }

    /// Ctrl-C: the exit code and what was printed.
    fn end(mut self) -> (Option<i32>, String) {
        assert!(Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap().success());
        let mut printed = String::new();
        self.child.stdout.take().unwrap().read_to_string(&mut printed).unwrap();
        (self.child.wait().unwrap().code(), printed)
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

struct Client {
    socket: WebSocket<TcpStream>,
}

impl Client {
    fn send(&mut self, message: &Value) {
        self.socket.send(Message::text(message.to_string())).unwrap();
    }

    fn look(&mut self, id: u64, camera: &Value, moving: bool) {
        self.send(&json!({ "id": id, "camera": camera, "moving": moving, "depth": false }));
    }

    /// The next message that is not a ping.
    fn next(&mut self) -> Message {
        loop {
            match self.socket.read().unwrap() {
                Message::Ping(_) | Message::Pong(_) => {}
                message => return message,
            }
        }
    }

    fn text(&mut self) -> Value {
        serde_json::from_str(self.next().to_text().unwrap()).unwrap()
    }

    /// Header and picture of the next frame.
    fn frame(&mut self) -> (Value, Vec<u8>) {
        let data = self.next().into_data();
        let (length, rest) = data.split_at(4);
        let (header, picture) = rest.split_at(u32::from_le_bytes(length.try_into().unwrap()) as usize);
        (serde_json::from_slice(header).unwrap(), picture.to_vec())
    }

    /// Code and reason with which it is closed.
    fn closed(&mut self) -> (CloseCode, String) {
        match self.next() {
            Message::Close(Some(why)) => (why.code, why.reason.to_string()),
            other => panic!("{other:?}"),
        }
    }
}

/// The camera of a view as told, moved to the right in its own axes.
fn moved(hello: &Value, view: usize, by: f64) -> Value {
    let mut camera = hello["views"][view]["camera"].clone();
    let x = camera["cam_from_world"][0][3].as_f64().unwrap();
    camera["cam_from_world"][0][3] = (x - by).into();
    camera
}

#[test]
fn pictures_arrive_and_at_rest_they_are_those_of_render() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &[]);
    let (mut client, hello) = viewer.client();
    assert_eq!(hello["views"].as_array().unwrap().len(), 5);
    let camera = moved(&hello, 2, 0.037);

    client.look(1, &camera, true);
    let (header, picture) = client.frame();
    assert_eq!((&header["id"], &header["moving"], &header["layers"]), (&1.into(), &true.into(), &"guided:1".into()));
    assert_eq!(picture[..2], [0xFF, 0xD8], "JPEG");

    client.look(2, &camera, false);
    let (header, shown) = client.frame();
    assert_eq!((&header["id"], &header["width"], &header["layers"]), (&2.into(), &64.into(), &"guided:2".into()));
    let (status, saved) = viewer.ask(&format!("POST /picture{}", viewer.query), &[], &camera.to_string());
    assert_eq!(status, 200);
    let (pose, picture) = (folders.out("pose.json"), folders.out("pose.png"));
    fs::write(&pose, camera.to_string()).unwrap();
    folders.render(&["--pose", &pose, "-o", &picture]).assert().success();
    let rendered = fs::read(&picture).unwrap();
    assert!(shown == rendered && saved == rendered);

    // A camera that was not shown is rendered for the file; a damaged one is refused.
    let (status, other) = viewer.ask("POST /picture", &[], &moved(&hello, 1, 0.0).to_string());
    assert!(status == 200 && other != rendered);
    let (status, reason) = viewer.ask("POST /picture", &[], r#"{"cam_from_world": 3}"#);
    assert!(status == 400 && String::from_utf8_lossy(&reason).contains("3 or 4 rows of 4 numbers"));
    assert_eq!(viewer.ask("POST /picture", &[], &"x".repeat(5000)).0, 413);

    drop(client);
    let (code, printed) = viewer.end();
    assert_eq!((code, printed.as_str()), (Some(0), "3 pictures for 1 viewer\n"));
}

#[test]
fn the_newest_pose_wins_for_each_client() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let ((mut one, hello), (mut two, _)) = (viewer.client(), viewer.client());
    // As many as may be on their way to a client that shows nothing.
    for id in [1, 2] {
        one.look(id, &moved(&hello, 2, 0.01 * id as f64), true);
        assert_eq!(one.frame().0["id"], id);
    }
    (3..=60).for_each(|id| one.look(id, &moved(&hello, 2, 0.001 * id as f64), true));
    // The other one is served all the same.
    two.look(7, &moved(&hello, 1, 0.01), false);
    assert_eq!(two.frame().0["id"], 7);
    one.send(&json!({ "shown": 1 }));
    assert_eq!(one.frame().0["id"], 60);
    // One that fails is told so, and the next is served.
    let mut astray = moved(&hello, 2, 0.0);
    astray["cam_from_world"] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
    two.look(8, &astray, false);
    assert!(two.text()["error"].as_str().unwrap().contains("look the target's way"));
    two.look(9, &moved(&hello, 2, 0.0), false);
    assert_eq!(two.frame().0["id"], 9);
    // The end of the program is told.
    let ended = std::thread::spawn(move || viewer.end().0);
    assert_eq!(two.closed(), (CloseCode::Away, "the program has ended".to_owned()));
    assert_eq!(one.closed().0, CloseCode::Away);
    drop((one, two));
    assert_eq!(ended.join().unwrap(), Some(0));
}

#[test]
fn no_other_page_gets_in() {
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
    assert!(viewer.open(&[]).is_ok(), "no page at all");
}

#[test]
fn a_chosen_address_needs_the_token_of_the_link() {
    let folders = Folders::new();
    let mut viewer = Viewer::start(&folders, &["--layers", "guided:1", "--bind", "127.0.0.1"]);
    assert!(viewer.query.starts_with("?token="));
    for path in ["/", "/photo/0"] {
        assert_eq!(viewer.status(&format!("GET {path}"), &[]), 403);
        assert_eq!(viewer.status(&format!("GET {path}?token=00"), &[]), 403);
        assert_eq!(viewer.status(&format!("GET {path}{}", viewer.query), &[]), 200);
    }
    let origin = ("Origin", "http://evil.example");
    assert_eq!(viewer.status(&format!("GET /{}", viewer.query), &[origin]), 403);
    viewer.client();
    viewer.query.clear();
    assert_eq!(viewer.open(&[]).err(), Some(403));
}

#[test]
fn a_hostile_message_closes_its_connection_alone_with_a_reason() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--layers", "guided:1"]);
    let (mut good, hello) = viewer.client();
    let mut large = moved(&hello, 2, 0.0);
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
    good.look(1, &moved(&hello, 2, 0.0), true);
    assert_eq!(good.frame().0["id"], 1);
}

#[test]
fn a_held_out_photo_is_scored_and_not_rendered_from() {
    let folders = Folders::new();
    let viewer = Viewer::start(&folders, &["--target", "2", "--layers", "surface:1"]);
    let (mut client, hello) = viewer.client();
    assert_eq!(hello["views"][2]["held_out"], true);
    client.look(1, &moved(&hello, 2, 0.0), false);
    let (header, picture) = client.frame();
    assert!(!header["views"].as_array().unwrap().contains(&2.into()));
    let target = folders.out("target.png");
    let told = folders.render(&["--target", "2", "--layers", "surface:1", "-o", &target, "--json"]).output().unwrap();
    let told: Value = serde_json::from_slice(&told.stdout).unwrap();
    assert_eq!((&header["truth"], &header["psnr"]), (&2.into(), &told["targets"][0]["psnr"]));
    assert!(header["psnr"].as_f64().unwrap() > 10.0 && picture == fs::read(&target).unwrap());
    client.look(2, &moved(&hello, 2, 0.001), false);
    assert_eq!(client.frame().0["psnr"], Value::Null);
}

#[test]
fn what_cannot_be_shown_is_refused_at_once() {
    let folders = Folders::new();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let model = fixture("tiny_v4");
    let refused = |arguments: &[&str], words: &[&str]| {
        let arguments = [&["--model", &model], arguments].concat();
        folders.assert_refused(&mut folders.liveview("view", &arguments), words);
    };
    refused(&["--port", &port], &[&port, "expected a free port", "--port 0"]);
    refused(&["--port", "0", "--heldout", "1"], &["--heldout 1", "expected 2 or more"]);
    refused(&["--port", "0", "--target", "7"], &["7"]);
    refused(&["--port", "0", "--heldout", "2"], &["4 views are needed"]);
}
