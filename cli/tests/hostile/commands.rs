//! The list of commands in commands.txt, each run by a shell in a separate folder.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use liveview::network::ExecutionProvider;
use rayon::prelude::*;

use crate::common::{self, Folders};
use crate::scene_common::{LLFF_ROW, picture, poses_bounds, write};
use crate::snapshot::snapshot;
use crate::{LIMIT, program, wheel};

/// One command and its expected result.
struct Attack {
    name: &'static str,
    /// Shell commands that prepare the folder.
    setup: Vec<&'static str>,
    arguments: &'static str,
    exit_code: i32,
    /// Expected parts of the message.
    messages: Vec<&'static str>,
}

impl Attack {
    fn parse(block: &'static str) -> Option<Self> {
        let mut lines = block.lines().filter(|line| !line.starts_with('#'));
        let name = lines.next()?;
        let (setup, rest): (Vec<_>, Vec<_>) = lines.partition(|line| line.starts_with("  "));
        let [arguments, result] = rest[..] else { panic!("{name}: expected the arguments and the result") };
        let (code, messages) = result.split_once(' ').unwrap_or((result, ""));
        let messages = messages.split(" | ").filter(|words| !words.is_empty()).collect();
        let arguments = arguments.strip_prefix("$ ").unwrap_or_else(|| panic!("{name}: expected `$ `"));
        Some(Self { name, setup, arguments, exit_code: code.parse().unwrap(), messages })
    }

    /// Runs the command; returns the difference from the expected result.
    fn failure(&self) -> Option<String> {
        let folders = folders();
        let root = folders.scene().parent().unwrap().to_owned();
        let shell = |script: &str| {
            let mut shell = Command::new("bash");
            shell.current_dir(&root).args(["-c", script]).env("LIVEVIEW", program());
            shell.env("MODEL", common::fixture("tiny_v4")).env("ORT", wheel::file(ExecutionProvider::Cpu).unwrap());
            shell.timeout(LIMIT).output().unwrap()
        };
        // Limits and variables apply only to the shell that sets them.
        let applies = |line: &&&str| line.starts_with("  ulimit") || line.starts_with("  export");
        let (limits, setup): (Vec<&str>, Vec<&str>) = self.setup.iter().partition(applies);
        let prepared = shell(&format!("set -e\n{}", setup.join("\n")));
        if !prepared.status.success() {
            return Some(format!("{}: {}", self.name, String::from_utf8_lossy(&prepared.stderr)));
        }
        let before = snapshot(&root);
        let defaults = [("--network none", "--model"), ("--threads 1", "--threads"), ("--layers planes:2", "--layers")];
        let renders = ["render ", "video "].iter().any(|command| self.arguments.starts_with(command));
        let defaults = defaults.iter().filter(|(_, given)| renders && !self.arguments.contains(given));
        let defaults = defaults.map(|(add, _)| *add);
        let defaults = defaults.collect::<Vec<_>>().join(" ");
        let output = shell(&format!("{}\nexec \"$LIVEVIEW\" {} {defaults}", limits.join("\n"), self.arguments));
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
        let after = snapshot(&root);
        let failed = |what: String| Some(format!("{}: {what}; {stderr}", self.name));
        if let Some((changed, _)) = before.iter().find(|(path, entry)| after.get(*path) != Some(entry)) {
            return failed(format!("{} is changed", changed.display()));
        }
        if output.status.code() != Some(self.exit_code) {
            return failed(format!("exit code {:?}, expected {}", output.status.code(), self.exit_code));
        }
        if let (2, Some(new)) = (self.exit_code, after.keys().find(|path| !before.contains_key(*path))) {
            return failed(format!("{} is left", new.display()));
        }
        let missing = self.messages.iter().find(|words| !stderr.contains(**words));
        missing.and_then(|words| failed(format!("\"{words}\" is missing")))
    }
}

#[test]
fn hostile_commands_end_as_expected_and_change_no_existing_file() {
    let attacks: Vec<_> = include_str!("commands.txt").split("\n\n").filter_map(Attack::parse).collect();
    assert!(attacks.len() > 40, "{} commands", attacks.len());
    let failures: Vec<_> = attacks.par_iter().filter_map(|attack| attack.failure()).collect();
    println!("{} commands", attacks.len());
    assert!(failures.is_empty(), "{} of {} commands:\n{}", failures.len(), attacks.len(), failures.join("\n"));
}

/// The files that commands.txt describes.
fn folders() -> Folders {
    let folders = Folders::new();
    let root = folders.scene().parent().unwrap().to_owned();
    let pose =
        |x: f64, more: &str| format!("{{\"cam_from_world\": [[1, 0, 0, {x}], [0, -1, 0, 0], [0, 0, -1, 0]]{more}}}");
    for (name, x, more) in [
        ("big.json", -0.2, ", \"w\": 8192, \"h\": 6144"),
        ("away.json", -50.0, ""),
        ("fov.json", -0.2, ", \"fov\": 60"),
        ("wide.json", -0.2, ", \"w\": 64"),
    ] {
        write(&root.join(name), pose(x, more));
    }
    picture(&root.join("photo.jpg"), 64, 48);
    rig(&folders, &root.join("rig"));
    llff(&root.join("llff"));
    folders
}

/// Writes a rig: each photo of the scene becomes a camera with six equal frames.
fn rig(folders: &Folders, rig: &Path) {
    let mut poses = fs::read_to_string(folders.scene().join("transforms.json")).unwrap();
    for camera in 0..5 {
        let folder = rig.join(format!("cam{camera}"));
        fs::create_dir_all(&folder).unwrap();
        (0..6).for_each(|frame| {
            fs::copy(folders.photo(camera), folder.join(format!("{frame:03}.png"))).unwrap();
        });
        poses = poses.replace(&format!("images/{camera}.png"), &format!("cam{camera}/000.png"));
    }
    write(&rig.join("transforms.json"), poses);
}

/// Writes an LLFF scene with full-size and reduced photos.
fn llff(llff: &Path) {
    let rows: [[f64; 17]; 5] = std::array::from_fn(|view| {
        let mut row = LLFF_ROW;
        row[3] += 0.1 * view as f64;
        picture(&llff.join(format!("images_4/{view}.png")), 16, 12);
        picture(&llff.join(format!("images/{view}.png")), 64, 48);
        row
    });
    poses_bounds(&llff.join("poses_bounds.npy"), &rows);
}
