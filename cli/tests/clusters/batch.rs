//! `liveview batch`: many renders in one process, with the same pictures as separate runs.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

use crate::common::{Folders, fixture};

fn batch(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_liveview")).arg("batch").args(arguments).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn lines(output: &Output) -> Vec<Value> {
    let text = std::str::from_utf8(&output.stdout).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect()
}

/// A command for the tiny scene.
fn command(folders: &Folders, arguments: &[&str]) -> Vec<String> {
    let scene = folders.scene();
    let words = [&[scene.to_str().unwrap(), "--threads", "1"], arguments].concat();
    words.into_iter().map(str::to_owned).collect()
}

fn write_list(folders: &Folders, commands: &[Vec<String>]) -> String {
    let list = folders.scene().join("list.jsonl");
    let text: Vec<String> = commands.iter().map(|command| json!(command).to_string()).collect();
    fs::write(&list, text.join("\n\n") + "\n").unwrap();
    list.to_str().unwrap().to_owned()
}

#[test]
fn batch_writes_the_pictures_of_its_commands_and_continues_after_errors() {
    let folders = Folders::new();
    let model = fixture("tiny_v4");
    let out = |name: &str| folders.out(name);
    let (a, b, c, d) = (out("a.png"), out("b"), out("c.png"), out("d.png"));
    let tiny = ["--model", model.as_str()];
    let render = |name: &str, layers: &str, file: &str| {
        command(&folders, &[&["--target", name, "--layers", layers, "-o", file][..], &tiny].concat())
    };
    let commands = [
        render("2", "guided:2", &a),
        render("no such view", "guided:2", &c),
        command(&folders, &["--path", "line:3", "--network", "none", "-o", &b]),
        // The same model, with other layers of the same kind and of another kind.
        render("1", "guided:1", &c),
        render("2", "planes:3", &d),
    ];
    let list = write_list(&folders, &commands);
    let done = folders.scene().join("done.jsonl");
    let output = batch(&[&list, "--done", done.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("error: 1 of 5 commands failed, the first in line 3"), "{}", stderr(&output));
    let report = lines(&output);
    assert_eq!(report.iter().map(|line| line["line"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 3, 5, 7, 9]);
    assert!(report[1]["error"].as_str().unwrap().contains("no such view"), "{}", report[1]);
    assert_eq!(report[2]["result"]["targets"].as_array().unwrap().len(), 3);

    let bytes = |file: &str| fs::read(file).unwrap();
    let batch_pictures = [&a, &c, &d, &format!("{b}/frame_0001.png")].map(|file| bytes(file));
    let inode = |file: &str| fs::metadata(file).unwrap().ino();
    let first = inode(&a);
    fs::remove_file(&c).unwrap();
    let again = batch(&[&list, "--done", done.to_str().unwrap()]);
    let kept: Vec<bool> = lines(&again).iter().map(|line| line["kept"] == true).collect();
    assert_eq!(kept, [true, false, true, false, true], "failed commands and missing files are rendered again");
    assert!(inode(&a) == first && Path::new(&c).exists());

    for (at, file) in [(0, &a), (3, &c), (4, &d), (2, &format!("{b}/frame_0001.png"))] {
        let alone = Command::new(env!("CARGO_BIN_EXE_liveview")).arg("render").args(&commands[at]).output().unwrap();
        assert!(alone.status.success(), "{}", stderr(&alone));
        assert!(batch_pictures.contains(&bytes(file)), "{file}");
    }
}

#[test]
fn truncated_done_file_is_continued_and_an_invalid_one_is_an_error() {
    let folders = Folders::new();
    let render = |name: &str| command(&folders, &["--target", "2", "--network", "none", "-o", &folders.out(name)]);
    let list = write_list(&folders, &[render("a.png"), render("b.png")]);
    let done = folders.scene().join("done.jsonl");
    let arguments = [list.as_str(), "--done", done.to_str().unwrap()];
    assert!(batch(&arguments).status.success());
    let text = fs::read_to_string(&done).unwrap();
    fs::write(&done, &text[..text.len() - 40]).unwrap();
    let kept = |output: &Output| lines(output).iter().map(|line| line["kept"] == true).collect::<Vec<_>>();
    assert_eq!(kept(&batch(&arguments)), [true, false]);
    assert_eq!(kept(&batch(&arguments)), [true, true]);
    fs::write(&done, format!("{}\nanother\n", text.lines().next().unwrap())).unwrap();
    let output = batch(&arguments);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("done.jsonl: line 2: expected a file of an earlier run"), "{}", stderr(&output));
}

#[test]
fn invalid_list_is_an_error_before_the_first_command() {
    let folders = Folders::new();
    let list = folders.scene().join("list.jsonl");
    let list = list.to_str().unwrap();
    let good = json!(command(&folders, &["--target", "2", "--network", "none", "-o", &folders.out("a.png")]));
    let refused = |text: &str, words: &[&str]| {
        fs::write(list, text).unwrap();
        let output = batch(&[list]);
        assert_eq!(output.status.code(), Some(2));
        for word in words {
            assert!(stderr(&output).contains(word), "\"{word}\" is missing in: {}", stderr(&output));
        }
        assert!(output.stdout.is_empty() && folders.written().is_empty());
    };
    refused("", &["list.jsonl: no command"]);
    refused(&format!("{good}\nrender scene"), &["list.jsonl: line 2", "expected a list of words"]);
    refused(&format!("{good}\n[\"scene\", 8]"), &["line 2", "expected a list of words"]);
    refused(&format!("{good}\n[\"scene\", \"--no-such\"]"), &["line 2", "unexpected argument '--no-such'"]);
    refused(&format!("{good}\n[\"scene\", \"-o\", \"a.png\"]"), &["line 2", "--target"]);
    refused(
        &format!("{good}\n[\"scene\", \"--widht\", \"9\"]"),
        &["line 2: unexpected argument '--widht' found tip: a", "'--width'"],
    );
    let two_threads = good.to_string().replace("\"1\"", "\"2\"");
    refused(&format!("{good}\n{two_threads}"), &["line 2: 2 threads, but line 1 has 1"]);
    fs::write(list, good.to_string()).unwrap();
    let output = batch(&[list, "--done", list]);
    assert!(stderr(&output).contains("would overwrite the list of commands"), "{}", stderr(&output));
    let photo = folders.photo(0);
    let output = batch(&[list, "--done", photo.to_str().unwrap()]);
    assert!(output.status.code() == Some(2) && folders.written().is_empty(), "{}", stderr(&output));
}
