//! The default, `--network none`: pictures from the views' distances and agreement, without a model or
//! ONNX Runtime; and what asks for a network.

use assert_cmd::Command;
use serde_json::Value;

use crate::common::{Folders, fixture};

/// A command that finds neither a model nor ONNX Runtime.
fn bare(folders: &Folders, command: &str, arguments: &[&str]) -> Command {
    let mut bare = folders.liveview(command, arguments);
    bare.env("ORT_DYLIB_PATH", folders.out("no-library.so")).env("LIVEVIEW_MODELS", folders.out("no-models"));
    bare
}

fn run(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn json(command: &mut Command) -> Value {
    serde_json::from_str(&run(command.arg("--json"))).unwrap()
}

#[test]
fn surface_layers_need_neither_model_nor_library_and_all_else_does() {
    let folders = Folders::new();
    let picture = folders.out("a.png");
    let target = ["--target", "2", "-o", &picture];
    let model = fixture("tiny_v4");
    for (ask, missing) in [
        (["--network", "model"], "liveview_v4.onnx"),
        (["--quality", "planes"], "liveview_v4.onnx"),
        (["--quality", "paper"], "liveview_v4.onnx"),
        (["--quality", "fast"], "liveview_v4.onnx"),
        (["--layers", "planes:4"], "liveview_v4.onnx"),
        (["--alpha", "competing"], "liveview_v4.onnx"),
        (["--engine", "cpu"], "liveview_v4.onnx"),
        (["--model", &model], "no-library.so"),
    ] {
        folders.assert_refused(bare(&folders, "render", &target).args(ask), &[missing]);
    }
    for words in
        [&["--quality", "surface"][..], &["--layers", "surface:1"], &["--network", "none", "--quality", "fast"]]
    {
        let report = json(bare(&folders, "render", &target).args(words));
        assert_eq!(report["model"], Value::Null, "{words:?}");
    }

    let none = target;
    let report = json(&mut bare(&folders, "render", &none));
    assert_eq!((&report["layers"], &report["model"]), (&"surface:3".into(), &Value::Null));
    assert_eq!(report["engine"]["name"], "none");
    assert_eq!(report["targets"][0]["views"].as_array().unwrap().len(), 4, "as with the default model");
    assert!(report["mean"]["psnr"].as_f64().unwrap() > 30.0, "{report}");
    let explanation = folders.out("e.png");
    let three = [&none[..], &["--views", "3", "--explain", &explanation]].concat();
    let text = run(&mut bare(&folders, "render", &three));
    assert!(
        text.contains("from 3 views") && text.contains("network none: views weighted by distance and agreement"),
        "{text}"
    );
}

#[test]
fn options_of_the_network_are_errors_without_one() {
    let folders = Folders::new();
    let refused = |command: &str, arguments: &[&str], words: &[&str]| {
        let arguments = [&["--target", "2", "--network", "none"], arguments].concat();
        folders.assert_refused(&mut bare(&folders, command, &arguments), words);
    };
    let picture = folders.out("a.png");
    let model = fixture("tiny_v4");
    for option in [["--model", &model], ["--precision", "f32"], ["--engine", "cpu"], ["--ort-lib", "lib.so"]] {
        refused("render", &[&["-o", &picture], &option[..]].concat(), &["--network", option[0], "cannot be used with"]);
    }
    refused(
        "render",
        &["-o", &picture, "--layers", "select:2/4"],
        &["--network none", "select:2/4", "needs a network"],
    );
    refused("inspect", &["--planes", "--layers", "select:2/4"], &["--network none", "cannot be used here"]);
    refused("sweep", &["-o", &picture, "--engines", "cpu int8"], &["--network", "--engines", "cannot be used with"]);
}

#[test]
fn a_note_says_that_a_model_was_trained_for_competing_layers_alone() {
    let folders = Folders::new();
    let models = concat!(env!("CARGO_MANIFEST_DIR"), "/../models");
    let arguments = ["--target", "2", "--views", "2", "--layers", "planes:2", "-o", &folders.out("a.png")];
    for (alpha, noted) in [("competing", false), ("independent", true)] {
        let mut render = folders.liveview("render", &arguments);
        let output = render.args(["--alpha", alpha]).env("LIVEVIEW_MODELS", models).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{stderr}");
        let note = stderr.contains("liveview_v2.onnx was trained for competing layers alone");
        assert_eq!(note, noted, "{alpha}: {stderr}");
    }
}
