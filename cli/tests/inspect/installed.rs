//! `liveview models` and `liveview manual`.

use std::fs;
use std::process::{Command, Output};

use serde_json::Value;

use crate::common::{Folders, fixture};

fn liveview(arguments: &[&str], models: &str) -> Output {
    let mut liveview = Command::new(env!("CARGO_BIN_EXE_liveview"));
    liveview.args(arguments).env("LIVEVIEW_MODELS", models).output().unwrap()
}

fn succeeds(output: Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn models_lists_cards_and_errors() {
    let folders = Folders::new();
    fs::copy(fixture("tiny_v4"), folders.out("liveview_v4.onnx")).unwrap();
    fs::copy(fixture("no_card"), folders.out("other.onnx")).unwrap();
    let report: Value = serde_json::from_str(&succeeds(liveview(&["models", "--json"], &folders.out("")))).unwrap();
    let models = report["models"].as_array().unwrap();
    assert_eq!(models.len(), 2, "{report}");
    assert!(models[0]["views"] == 4 && models[0]["recommended_layers"] == "guided:2", "{report}");
    assert!(models[1]["error"].as_str().unwrap().contains("other.onnx"), "{report}");
    let text = succeeds(liveview(&["models"], &folders.out("")));
    assert!(text.contains("recommended guided:2") && text.contains("cannot be used"), "{text}");
    let none = succeeds(liveview(&["models"], folders.scene().to_str().unwrap()));
    assert!(none.contains("no model (.onnx) in"), "{none}");
}

#[test]
fn manual_writes_pages_and_completions() {
    let folders = Folders::new();
    let bash = succeeds(liveview(&["manual", "--shell", "bash"], ""));
    assert!(bash.contains("complete -F _liveview") && bash.contains("--shard"), "{bash}");
    succeeds(liveview(&["manual", "-o", &folders.out("man1")], ""));
    let page = fs::read_to_string(folders.out("man1/liveview-render.1")).unwrap();
    assert!(page.contains("shard") && folders.written().contains(&"man1/liveview.1".to_owned()), "{page}");
    let neither = liveview(&["manual"], "");
    assert_eq!(neither.status.code(), Some(2));
}
