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
fn a_model_has_a_card_or_an_error() {
    let folders = Folders::new();
    let text = succeeds(inspect(&[&fixture("tiny_v4")]));
    assert!(text.contains("recommended guided:2"), "{text}");
    let report: Value = serde_json::from_str(&succeeds(inspect(&[&fixture("tiny_v4"), "--json"]))).unwrap();
    assert!(report["views"] == 4 && report["recommended_layers"] == "guided:2", "{report}");
    let refused = inspect(&[&fixture("no_card")]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("no_card"), "{refused:?}");
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
    let text = succeeds(inspect(&[&folders.out("forged.onnx")]));
    assert!(text.contains("x\\n  licence    free\\u{7}\n  licence     MIT"), "{text}");
    let unusable = String::from_utf8(inspect(&[&folders.out("odd\nadvice.onnx")]).stderr).unwrap();
    assert!(
        unusable.contains("odd\\nadvice.onnx")
            && unusable.contains("metadata `recommended_layers` is \"many\", expected"),
        "{unusable}"
    );
    let picture = folders.out("a.png");
    let mut render = folders.liveview("render", &["--target", "2", "-o", &picture, "--layers", "guided:1"]);
    let output = render.args(["--model", &folders.out("forged.onnx")]).output().unwrap();
    assert!(succeeds(output).contains("x\\n  licence"), "the summary of a render");
}
