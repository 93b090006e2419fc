//! The list of commands in commands.txt, each run by a shell in a folder of its own.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use liveview::network::ExecutionProvider;
use rayon::prelude::*;

use crate::common::{self, Folders};
use crate::scene_common::{LLFF_ROW, picture, poses_bounds, write};
use crate::snapshot::snapshot;
use crate::{LIMIT, program, wheel};

/// One command and its end.
struct Attack {
    name: &'static str,
    /// Shell: what is there beforehand.
    before: Vec<&'static str>,
    arguments: &'static str,
    exit_code: i32,
    /// Words of the message.
    says: Vec<&'static str>,
}

impl Attack {
    fn parse(block: &'static str) -> Option<Self> {
        let mut lines = block.lines().filter(|line| !line.starts_with('#'));
        let name = lines.next()?;
        let (before, rest): (Vec<_>, Vec<_>) = lines.partition(|line| line.starts_with("  "));
        let [arguments, end] = rest[..] else { panic!("{name}: expected the arguments and the end") };
        let (code, says) = end.split_once(' ').unwrap_or((end, ""));
        let says = says.split(" | ").filter(|words| !words.is_empty()).collect();
        let arguments = arguments.strip_prefix("$ ").unwrap_or_else(|| panic!("{name}: expected `$ `"));
        Some(Self { name, before, arguments, exit_code: code.parse().unwrap(), says })
    }

    /// What is wrong with how it ended.
    fn fault(&self) -> Option<String> {
        let folders = folders();
        let root = folders.scene().parent().unwrap().to_owned();
        let shell = |script: &str| {
            let mut shell = Command::new("bash");
            shell.current_dir(&root).args(["-c", script]).env("LIVEVIEW", program());
            shell.env("MODEL", common::fixture("tiny_v4")).env("ORT", wheel::file(ExecutionProvider::Cpu).unwrap());
            shell.timeout(LIMIT).output().unwrap()
        };
        // Limits hold for the shell that sets them.
        let (limits, before): (Vec<&str>, Vec<&str>) =
            self.before.iter().partition(|line| line.starts_with("  ulimit"));
        assert!(shell(&format!("set -e\n{}", before.join("\n"))).status.success(), "{}: {before:?}", self.name);
        let all = snapshot(&root);
        let open = [("--network none", "--model"), ("--threads 1", "--threads"), ("--layers planes:2", "--layers")];
        let open = open.iter().filter(|(_, given)| !self.arguments.contains(given)).map(|(add, _)| *add);
        let added = open.collect::<Vec<_>>().join(" ");
        let output = shell(&format!("{}\nexec \"$LIVEVIEW\" {} {added}", limits.join("\n"), self.arguments));
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
        let after = snapshot(&root);
        let failed = |what: String| Some(format!("{}: {what}; {stderr}", self.name));
        if let Some((changed, _)) = all.iter().find(|(path, entry)| after.get(*path) != Some(entry)) {
            return failed(format!("{} is changed", changed.display()));
        }
        if output.status.code() != Some(self.exit_code) {
            return failed(format!("ended with {:?}, not {}", output.status.code(), self.exit_code));
        }
        if let (2, Some(new)) = (self.exit_code, after.keys().find(|path| !all.contains_key(*path))) {
            return failed(format!("left {} behind", new.display()));
        }
        let missing = self.says.iter().find(|words| !stderr.contains(**words));
        missing.and_then(|words| failed(format!("\"{words}\" is missing")))
    }
}

#[test]
fn the_commands_of_an_attack() {
    let attacks: Vec<_> = include_str!("commands.txt").split("\n\n").filter_map(Attack::parse).collect();
    assert!(attacks.len() > 40, "{} commands", attacks.len());
    let (later, now): (Vec<_>, Vec<_>) = attacks.iter().partition(|attack| attack.name.starts_with("later: "));
    let faults: Vec<_> = now.par_iter().filter_map(|attack| attack.fault()).collect();
    println!("{} commands, and {} later", now.len(), later.len());
    assert!(faults.is_empty(), "{} of {} commands:\n{}", faults.len(), now.len(), faults.join("\n"));
}

/// What commands.txt says that there is.
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

/// The scene's photos, each as six frames of a camera.
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
