//! `liveview inspect` of models.

use std::fs;
use std::process::{Command, Output};

use serde_json::Value;

use crate::common::{Folders, fixture};

fn inspect(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_liveview")).arg("inspect").args(arguments).output().unwrap()
}

fn succeeds(output: Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn models_are_listed_with_cards_and_errors() {
    let folders = Folders::new();
    fs::copy(fixture("tiny_v4"), folders.out("liveview_v4.onnx")).unwrap();
    fs::copy(fixture("no_card"), folders.out("other.onnx")).unwrap();
    let report: Value = serde_json::from_str(&succeeds(inspect(&[&folders.out(""), "--json"]))).unwrap();
    let models = report["models"].as_array().unwrap();
    assert_eq!(models.len(), 2, "{report}");
    assert!(models[0]["views"] == 4 && models[0]["recommended_layers"] == "guided:2", "{report}");
    assert!(models[1]["error"].as_str().unwrap().contains("other.onnx"), "{report}");
    let text = succeeds(inspect(&[&folders.out("")]));
    assert!(text.contains("recommended guided:2") && text.contains("cannot be used"), "{text}");
    let one: Value = serde_json::from_str(&succeeds(inspect(&[&folders.out("liveview_v4.onnx"), "--json"]))).unwrap();
    assert_eq!(one, models[0]);
    let refused = inspect(&[&folders.out("other.onnx")]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("other.onnx"), "{refused:?}");
    // A scene stays a scene, with a model beside its photos.
    fs::copy(fixture("tiny_v4"), folders.scene().join("liveview_v4.onnx")).unwrap();
    let scene = succeeds(inspect(&[folders.scene().to_str().unwrap(), "--near", "2", "--far", "8"]));
    assert!(scene.starts_with("scene "), "{scene}");
}

#[test]
fn metadata_cannot_forge_lines_and_layers_that_cannot_be_parsed_are_an_error() {
    let folders = Folders::new();
    let (own, forged) = ("none: a test fixture", "x\n  licence    free\u{7}");
    let model = fs::read(fixture("tiny_v4")).unwrap();
    let at = model.windows(own.len()).position(|text| text == own.as_bytes()).expect("what the fixture says");
    assert_eq!(own.len(), forged.len());
    fs::write(folders.out("forged.onnx"), [&model[..at], forged.as_bytes(), &model[at + own.len()..]].concat())
        .unwrap();
    fs::copy(fixture("odd_advice"), folders.out("odd\nadvice.onnx")).unwrap();
    let text = succeeds(inspect(&[&folders.out("")]));
    assert!(text.contains("x\\n  licence    free\\u{7}\n  licence     MIT"), "{text}");
    let unusable = "odd\\nadvice.onnx\n  cannot be used: ";
    assert!(text.contains(unusable) && text.contains("metadata `recommended_layers` is \"many\", expected"), "{text}");
    let picture = folders.out("a.png");
    let mut render = folders.liveview("render", &["--target", "2", "-o", &picture, "--layers", "guided:1"]);
    let output = render.args(["--model", &folders.out("forged.onnx")]).output().unwrap();
    assert!(succeeds(output).contains("x\\n  licence"), "the summary of a render");
}
