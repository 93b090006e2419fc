//! Attacks by seed on a whole run: a damaged example scene, options, cameras, caches and models, too little
//! memory, signals, and two runs into one folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use liveview_files::atomic::TEMPORARY;
use serde_json::json;

use crate::common::{Folders, fixture};
use crate::scene::Random;
use crate::{LIMIT, program};

/// Whether a run gave a picture (else one error), or how it failed.
pub(crate) type Outcome = Result<bool, String>;

/// Values in place of a number.
const VALUES: [&str; 12] =
    ["NaN", "1e308", "-1e308", "1e-308", "1e-320", "0", "-1", "1e20", "\"a\"", "null", "[]", "18446744073709551616"];

pub(crate) fn attack(seed: u64) -> Outcome {
    let mut random = Random::new(seed);
    match seed / 2 % 10 {
        0..=3 => example(&mut random),
        4 => options(&mut random),
        5 => camera(&mut random),
        6 => cache(&mut random),
        7 => memory(&mut random),
        8 => signal(&mut random),
        _ if random.below(2) == 0 => model(&mut random),
        _ => two_runs(&mut random),
    }
}

/// `liveview ARGUMENTS` on one thread, within the time limit of a test.
fn run(arguments: &[&str]) -> Output {
    let mut command = assert_cmd::Command::new(program());
    command.args(arguments);
    if ["render", "depth"].contains(&arguments[0]) {
        command.args(["--threads", "1"]);
    }
    command.timeout(LIMIT).output().unwrap()
}

/// Exit code 0 with files that are complete, or 2 with one error that contains one of `names`, and nothing written.
fn judge(what: &str, output: &Output, out: &Path, names: &[&str]) -> Outcome {
    let stderr = String::from_utf8_lossy(&output.stderr);
    let failed = |why: String| Err(format!("{what}: {why}; {stderr}"));
    let written = files(out);
    if stderr.contains("panicked") {
        return failed("panicked".to_owned());
    }
    if let Some(left) = written.iter().find(|path| is_temporary(path)) {
        return failed(format!("{} is left", left.display()));
    }
    match output.status.code() {
        Some(0) => damaged(&written).map_or(Ok(true), failed),
        // `depth` keeps the photos that it has done before the one that cannot be read.
        Some(2) if !written.is_empty() && !what.starts_with("depth") => failed(format!("{written:?} are left")),
        Some(2) => {
            if let Some(damaged) = damaged(&written) {
                return failed(damaged);
            }
            let errors: Vec<_> =
                stderr.match_indices("error: ").filter(|(at, _)| *at == 0 || stderr[..*at].ends_with('\n')).collect();
            let [(at, _)] = errors[..] else { return failed("not one error".to_owned()) };
            let error = &stderr[at..];
            if names.iter().any(|name| error.contains(name)) {
                Ok(false)
            } else {
                failed(format!("none of {names:?} is named"))
            }
        }
        Some(code) => failed(format!("exit code {code}")),
        None => failed("a signal or the time limit".to_owned()),
    }
}

/// All files in a folder and its subfolders.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

fn is_temporary(path: &Path) -> bool {
    path.file_name().unwrap().to_str().unwrap().starts_with(TEMPORARY)
}

/// A file among these that is empty, or no picture by its name.
fn damaged(files: &[PathBuf]) -> Option<String> {
    let broken = |path: &&PathBuf| {
        let picture = path.extension().is_some_and(|extension| extension == "png" || extension == "jpg");
        fs::metadata(path).unwrap().len() == 0 || picture && image::open(path).is_err()
    };
    files.iter().find(broken).map(|path| format!("{} is damaged", path.display()))
}

/// Damages the bytes of a file; returns a description.
fn damage(path: &Path, random: &mut Random) -> String {
    let mut bytes = fs::read(path).unwrap();
    let name = path.file_name().unwrap().display();
    let what = match random.below(4) {
        0 => {
            bytes.truncate(random.below(bytes.len()));
            format!("{name} has {} bytes", bytes.len())
        }
        1 => {
            let (at, count) = (random.below(bytes.len()), 1 + random.below(600));
            bytes.iter_mut().skip(at).take(count).for_each(|byte| *byte = 0);
            format!("{count} bytes of {name} are 0 from {at} on")
        }
        2 => {
            let at = random.below(bytes.len());
            let twice = bytes[at..].to_vec();
            bytes.extend(twice);
            format!("{name} goes on from {at} at its end")
        }
        _ => {
            let flips: Vec<usize> = (0..1 + random.below(8)).map(|_| random.below(8 * bytes.len())).collect();
            flips.iter().for_each(|bit| bytes[bit / 8] ^= 1 << (bit % 8));
            format!("bits {flips:?} of {name} are others")
        }
    };
    fs::write(path, bytes).unwrap();
    what
}

/// Replaces a number of a JSON text, or removes or doubles a line of it; returns a description.
pub(crate) fn change_json(text: &str, random: &mut Random) -> (String, String) {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let numbers: Vec<usize> =
        (0..lines.len()).filter(|&line| lines[line].contains(|c: char| c.is_ascii_digit())).collect();
    let line = *random.of(&numbers);
    let what = match random.below(8) {
        0 => format!("line {line} is missing: {}", lines.remove(random.below(line + 1))),
        1 => {
            lines.insert(line, lines[line].clone());
            format!("line {line} stands twice")
        }
        _ => {
            let value = *random.of(&VALUES);
            let start = lines[line].find([':']).map_or(0, |colon| colon + 1);
            let comma = if lines[line].ends_with(',') { "," } else { "" };
            let what = format!("line {line}, {}, is {value}", lines[line].trim());
            lines[line] = format!("{} {value}{comma}", &lines[line][..start]);
            what
        }
    };
    (lines.join("\n"), what)
}

/// The scene `tests/scenes/walls`, damaged, read by one of the commands.
fn example(random: &mut Random) -> Outcome {
    let root = tempfile::tempdir().unwrap();
    let (scene, out) = (root.path().join("walls"), root.path().join("out"));
    let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/scenes/walls");
    for source in
        files(&original).into_iter().filter(|path| path.extension().is_some_and(|extension| extension != "py"))
    {
        let copy = scene.join(source.strip_prefix(&original).unwrap());
        fs::create_dir_all(copy.parent().unwrap()).unwrap();
        fs::copy(source, copy).unwrap();
    }
    fs::create_dir(&out).unwrap();
    let mut what = Vec::new();
    for _ in 0..1 + random.below(2) {
        let poses = scene.join("transforms.json");
        let photo = scene.join("images").join(random.of(&["photo_0.png", "photo_2.png", "photo_5.png", "target.png"]));
        what.push(match random.below(5) {
            0 => damage(&poses, random),
            1 if photo.exists() => damage(&photo, random),
            2 if photo.exists() => {
                fs::remove_file(&photo).unwrap();
                format!("{} is missing", photo.display())
            }
            _ => {
                let (text, what) = change_json(&String::from_utf8_lossy(&fs::read(&poses).unwrap()), random);
                fs::write(&poses, text).unwrap();
                what
            }
        });
    }
    let (picture, page) = (out.join("a.png"), out.join("a.html"));
    let [scene, out_text, picture, page] = [&scene, &out, &picture, &page].map(|path| path.to_str().unwrap());
    let render = ["render", scene, "--target", "target", "--network", "none", "-o", picture, "--layers"];
    let commands: [Vec<&str>; 6] = [
        [&render[..], &["guided:1"]].concat(),
        [&render[..], &["surface:1", "--width", "64"]].concat(),
        [&render[..], &["planes:4", "--keep-exposure"]].concat(),
        vec!["depth", scene, "--width", "64", "-o", out_text],
        vec!["inspect", scene],
        vec!["bake", scene, "--target", "target", "--width", "48", "-o", page],
    ];
    let command = random.of(&commands);
    let what = format!("{}: {}", command[0], what.join(", "));
    let output = run(command);
    let names =
        ["transforms.json", "photo_", "target", scene, "no view covers", "views are needed", "expected near", "photos"];
    judge(&what, &output, &out, &names)
}

/// Options with values that they may not have.
fn options(random: &mut Random) -> Outcome {
    let folders = Folders::new();
    let (scene, picture) = (folders.scene(), folders.out("a.png"));
    let options = [
        "--near",
        "--far",
        "--width",
        "--views",
        "--layers",
        "--fps",
        "--jpeg-quality",
        "--target",
        "--path",
        "--threads",
        "--batch",
        "--heldout",
        "--fov",
        "--background",
        "--images",
        "--format",
        "--frames",
        "--pose",
    ];
    let values = [
        "nan",
        "inf",
        "1e308",
        "1e-308",
        "-1",
        "0",
        "1",
        "2",
        "",
        " ",
        "a",
        "99999999999999999999",
        "guided:0",
        "planes:1e9",
        "surface:-1",
        "list:",
        "line:0",
        "circle:5000",
        "..",
        "/dev/null",
        "\u{202e}x",
        "2:1",
        "1,1",
        "=",
        "--",
        "\u{1b}[2J",
    ];
    let mut arguments = vec!["render".to_owned(), scene.to_str().unwrap().to_owned(), "-o".to_owned(), picture.clone()];
    arguments.extend(["--network", "none"].map(str::to_owned));
    let given: Vec<(&str, &str)> =
        (0..1 + random.below(2)).map(|_| (*random.of(&options), *random.of(&values))).collect();
    arguments.extend(given.iter().map(|(option, value)| format!("{option}={value}")));
    if !given.iter().any(|(option, _)| ["--target", "--path", "--pose", "--heldout"].contains(option)) {
        arguments.push("--target=2".to_owned());
    }
    let output = assert_cmd::Command::new(program()).args(&arguments).timeout(LIMIT).output().unwrap();
    let mut names: Vec<&str> = given.iter().map(|(option, _)| *option).collect();
    names.extend(given.iter().map(|(_, value)| *value).filter(|value| value.len() > 1));
    names.extend(["near", "views", "no view", "frames", "images", "pictures", "cannot be used with", "required"]);
    judge(&format!("{given:?}"), &output, Path::new(&picture).parent().unwrap(), &names)
}

/// A camera file with a number that is extreme, or a damaged one.
fn camera(random: &mut Random) -> Outcome {
    let folders = Folders::new();
    let file = folders.scene().join("pose.json");
    let pose = json!([[1, 0, 0, -0.2], [0, -1, 0, 0], [0, 0, -1, 0]]);
    let camera = json!({ "cam_from_world": pose, "fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48 });
    let path = json!({ "camera_type": "perspective", "render_width": 64, "render_height": 48,
        "camera_path": [{ "camera_to_world": [1, 0, 0, 0.2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], "fov": 50 }] });
    let text = serde_json::to_string_pretty(random.of(&[camera.clone(), json!([camera, camera]), path])).unwrap();
    let (text, mut what) = change_json(&text, random);
    fs::write(&file, text).unwrap();
    if random.below(4) == 0 {
        what = damage(&file, random);
    }
    let (scene, out) = (folders.scene(), folders.out("a"));
    let layers = *random.of(&["guided:1", "planes:4", "surface:1"]);
    let arguments = [
        "render",
        scene.to_str().unwrap(),
        "--path",
        file.to_str().unwrap(),
        "--network",
        "none",
        "-o",
        &out,
        "--layers",
        layers,
    ];
    let output = run(&arguments);
    judge(
        &what,
        &output,
        Path::new(&out).parent().unwrap(),
        &["pose.json", "no view covers", "views are needed", "expected near"],
    )
}

/// A damaged cache gives the picture that an empty one gives.
fn cache(random: &mut Random) -> Outcome {
    let folders = Folders::new();
    let (scene, cache) = (folders.scene(), folders.scene().join("cache"));
    let render = |name: &str| {
        let picture = folders.out(name);
        let arguments = [
            "render",
            scene.to_str().unwrap(),
            "--target",
            "2",
            "--network",
            "none",
            "--layers",
            "surface:1",
            "--cache",
        ];
        (run(&[&arguments[..], &[cache.to_str().unwrap(), "-o", &picture]].concat()), picture)
    };
    let (first, expected) = render("a.png");
    let kept = files(&cache);
    if !first.status.success() || kept.is_empty() {
        return Err(format!("no cache: {}", String::from_utf8_lossy(&first.stderr)));
    }
    let (file, other) = (random.of(&kept).clone(), random.of(&kept).clone());
    let what = match random.below(6) {
        0 => {
            fs::copy(&other, &file).map(|_| ()).unwrap();
            format!("{} in place of {}", other.display(), file.display())
        }
        1 => {
            fs::remove_file(&file).unwrap();
            fs::create_dir(&file).unwrap();
            "a folder in place of a file".to_owned()
        }
        _ => damage(&file, random),
    };
    let (output, picture) = render("b.png");
    judge(&what, &output, Path::new(&picture).parent().unwrap(), &[file.file_name().unwrap().to_str().unwrap()])?;
    match output.status.success() && fs::read(&picture).unwrap() != fs::read(&expected).unwrap() {
        true => Err(format!("{what}: another picture")),
        false => Ok(true),
    }
}

/// Too little memory for a large picture.
fn memory(random: &mut Random) -> Outcome {
    let folders = Folders::new();
    let (scene, out) = (folders.scene(), folders.out("a.png"));
    let folder = Path::new(&out).parent().unwrap().to_str().unwrap();
    let scene = scene.to_str().unwrap();
    let width = (64 << random.below(7)).to_string();
    let render = [
        "render",
        scene,
        "--target",
        "2",
        "--network",
        "none",
        "-o",
        &out,
        "--threads",
        "1",
        "--width",
        &width,
        "--layers",
    ];
    let commands = [
        [&render[..], &["guided:1"]].concat(),
        [&render[..], &["surface:2"]].concat(),
        [&render[..], &["planes:16"]].concat(),
        vec!["depth", scene, "--threads", "1", "--width", &width, "-o", folder],
        vec!["inspect", scene, "--width", &width],
    ];
    let kilobytes = 40_000 + random.below(400_000);
    let command = random.of(&commands);
    let mut shell = assert_cmd::Command::new("sh");
    shell
        .args(["-c", &format!("ulimit -c 0; ulimit -v {kilobytes} && exec \"$0\" \"$@\"")])
        .arg(program())
        .args(command);
    // Each thread would reserve address space.
    let output = shell.env("RAYON_NUM_THREADS", "1").env("MALLOC_ARENA_MAX", "1").timeout(LIMIT).output().unwrap();
    judge(&format!("{kilobytes} kB for {}", command.join(" ")), &output, Path::new(folder), &["memory", "thread", "MB"])
}

/// A signal at any time: what is written is complete, and so is the next run.
fn signal(random: &mut Random) -> Outcome {
    let folders = Folders::new();
    let (scene, out) = (folders.scene(), folders.out("path"));
    let arguments =
        ["render", scene.to_str().unwrap(), "--path", "line:3", "--network", "none", "--threads", "1", "-o", &out];
    let layers = *random.of(&["guided:1", "surface:1"]);
    let start = || {
        let mut command = Command::new(program());
        command.args(arguments).args(["--layers", layers]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let name = *random.of(&["-KILL", "-TERM", "-INT"]);
    let wait = random.below(80_000);
    let mut child = start();
    sleep(Duration::from_micros(wait as u64));
    let _ = Command::new("kill").args([name, &child.id().to_string()]).stderr(Stdio::null()).status();
    child.wait().unwrap();
    let what = format!("{name} after {wait} µs, {layers}");
    let written = files(Path::new(&out));
    let (temporary, complete): (Vec<_>, Vec<_>) = written.into_iter().partition(|path| is_temporary(path));
    if let Some(damaged) = damaged(&complete) {
        return Err(format!("{what}: {damaged}"));
    }
    if name != "-KILL" && !temporary.is_empty() {
        return Err(format!("{what}: {temporary:?} are left"));
    }
    // A killed run cannot delete its own, nor can another run know whose it is.
    temporary.iter().for_each(|path| fs::remove_file(path).unwrap());
    let output = run(&[&arguments[..6], &["-o", &out, "--layers", layers]].concat());
    let pictures =
        files(Path::new(&out)).iter().filter(|path| path.extension().is_some_and(|end| end == "png")).count();
    if output.status.code() == Some(0) && pictures != 3 {
        return Err(format!("{what}: {pictures} pictures: {}", String::from_utf8_lossy(&output.stderr)));
    }
    judge(&what, &output, Path::new(&out), &["nothing is expected to be refused"])
}

/// A damaged model.
fn model(random: &mut Random) -> Outcome {
    let folders = Folders::new();
    let (scene, picture, file) = (folders.scene(), folders.out("a.png"), folders.scene().join("model.onnx"));
    fs::copy(fixture("tiny_v4"), &file).unwrap();
    let what = damage(&file, random);
    let arguments =
        ["render", scene.to_str().unwrap(), "--target", "2", "--model", file.to_str().unwrap(), "-o", &picture];
    judge(&what, &run(&arguments), Path::new(&picture).parent().unwrap(), &["model.onnx", "--layers", "network"])
}

/// Two runs into one folder: each picture is complete.
fn two_runs(random: &mut Random) -> Outcome {
    let folders = Folders::new();
    let (scene, out) = (folders.scene(), folders.out("both"));
    let paths = [["--path", "line:3"], *random.of(&[["--path", "line:3"], ["--path", "line:4"], ["--heldout", "5"]])];
    let start = |target: [&str; 2]| {
        let mut command = Command::new(program());
        let arguments = [
            "render",
            scene.to_str().unwrap(),
            "--network",
            "none",
            "--threads",
            "1",
            "--layers",
            "guided:1",
            "-o",
            &out,
        ];
        command.args(arguments).args(target).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let runs = paths.map(start).map(|child| child.wait_with_output().unwrap());
    let what = format!("two runs, {:?}", paths[1]);
    let mut any = false;
    for output in &runs {
        let stderr = String::from_utf8_lossy(&output.stderr);
        match output.status.code() {
            Some(0) => any = true,
            Some(2) if stderr.contains("both") && !stderr.contains("panicked") => {}
            code => return Err(format!("{what}: {code:?}; {stderr}")),
        }
    }
    let written = files(Path::new(&out));
    let wrong = written.iter().find(|path| is_temporary(path)).map(|path| format!("{} is left", path.display()));
    match wrong.or_else(|| damaged(&written)).or_else(|| (!any).then(|| "neither run ended".to_owned())) {
        Some(wrong) => Err(format!("{what}: {wrong}")),
        None => Ok(true),
    }
}
