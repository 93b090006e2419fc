//! `liveview sweep`.

mod common;

use std::fs;

use assert_cmd::Command;
use common::{Folders, fixture};
use serde_json::Value;

fn sweep(folders: &Folders, arguments: &[&str]) -> Command {
    let mut sweep = folders.liveview("sweep", arguments);
    sweep.args(["--target", "2", "--repetitions", "2", "--model"]).arg(fixture("tiny_v4"));
    sweep.args(["-o", &folders.out("report")]);
    sweep
}

fn json(command: &mut Command) -> Value {
    let output = command.arg("--json").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn each_configuration_has_an_error_and_a_time() {
    let folders = Folders::new();
    let report = json(&mut sweep(&folders, &["--layers", "guided:1,guided:2,select:2,planes:4,planes:64"]));
    assert_eq!(folders.written(), ["report/sweep.json", "report/sweep.md", "report/sweep.svg"]);
    let rows = report["rows"].as_array().unwrap();
    let named: Vec<&str> = rows.iter().map(|row| row["layers"].as_str().unwrap()).collect();
    assert_eq!(named, ["guided:1", "guided:2", "select:2/64", "planes:4", "planes:64"]);
    for row in rows {
        let times = row["seconds"]["all"].as_array().unwrap();
        assert_eq!(times.len(), 2, "{row}");
        assert!(times.iter().all(|time| time.as_f64().unwrap() > 0.0), "{row}");
        assert!(row["psnr"].as_f64().unwrap() > 15.0 && row["peak_memory_bytes"].as_u64().unwrap() > 1 << 20, "{row}");
    }
    assert!(rows[2]["seconds"]["once"].as_f64().unwrap() > 0.0, "the selection is reported separately");
    assert!(rows[2]["seconds"]["stages"].get("select").is_none(), "and is not part of each frame's time");
    assert!(rows[4]["seconds"]["stages"]["network"].as_f64().unwrap() > 0.0);
    // The same picture as `render` makes.
    let rendered = json(&mut folders.render(&["--target", "2", "--layers", "planes:4", "-o", &folders.out("a.png")]));
    assert!((rendered["mean"]["psnr"].as_f64().unwrap() - rows[3]["psnr"].as_f64().unwrap()).abs() < 1e-6);
}

#[test]
fn engines_adds_rows_for_guided_layers() {
    let folders = Folders::new();
    let report = json(&mut sweep(&folders, &["--layers", "guided:1,planes:2", "--engines", "cpu f32"]));
    let rows: Vec<_> = report["rows"].as_array().unwrap().iter().map(|row| (&row["layers"], &row["engine"])).collect();
    let [guided, planes] = ["guided:1", "planes:2"].map(Value::from);
    let cpu = Value::from("cpu, f32");
    assert_eq!(rows, [(&guided, &cpu), (&planes, &cpu), (&guided, &cpu)]);
    let mut unknown = sweep(&folders, &["--engines", "abacus"]);
    let said = String::from_utf8(unknown.output().unwrap().stderr).unwrap();
    assert!(said.contains("--engines") && said.contains("abacus"), "{said}");
}

#[test]
fn surface_layers_are_also_measured_without_a_network() {
    let folders = Folders::new();
    let report = json(&mut sweep(&folders, &["--layers", "surface:1,planes:2", "--engines", "cpu f32"]));
    let rows = report["rows"].as_array().unwrap();
    let text = |row: &Value, key: &str| row[key].as_str().unwrap().to_owned();
    let named: Vec<String> = rows.iter().map(|row| text(row, "layers") + ", " + &text(row, "engine")).collect();
    let [own, planes] = ["surface:1, cpu, f32", "planes:2, cpu, f32"];
    assert_eq!(named, [own, planes, "surface:1, no network", "surface:3, no network", own]);
    assert!(rows[2..4].iter().all(|row| row["psnr"].as_f64().unwrap() > 30.0), "{report}");
    let table = fs::read_to_string(folders.out("report/sweep.md")).unwrap();
    assert!(table.contains("| surface:1 | no network |"), "{table}");
    assert!(fs::read_to_string(folders.out("report/sweep.svg")).unwrap().contains(">surface, no network<"));
    assert_eq!(report["model"], "tiny_v4.onnx", "of the network beside it");

    let mut alone = folders.liveview("sweep", &["--target", "2", "--repetitions", "1", "--network", "none"]);
    let report = json(alone.args(["--layers", "surface:1", "-o", &folders.out("report")]));
    assert_eq!((report["rows"].as_array().unwrap().len(), &report["model"]), (1, &"none".into()));
}

#[test]
fn widths_scale_the_photos() {
    let folders = Folders::new();
    let report = json(&mut sweep(&folders, &["--layers", "planes:2", "--widths", "32,64"]));
    let widths: Vec<u64> =
        report["rows"].as_array().unwrap().iter().map(|row| row["width"].as_u64().unwrap()).collect();
    assert_eq!(widths, [32, 64]);
    assert!(fs::read_to_string(folders.out("report/sweep.svg")).unwrap().contains("megapixels"));
}

#[test]
fn several_targets_are_scored_by_their_mean() {
    let folders = Folders::new();
    let psnr = |targets: &str| {
        let mut sweep =
            folders.liveview("sweep", &["--target", targets, "--repetitions", "1", "--layers", "surface:1"]);
        let report = json(sweep.args(["--views", "2", "--network", "none", "-o", &folders.out("report")]));
        report["rows"][0]["psnr"].as_f64().unwrap()
    };
    let pictures = folders.out("p/");
    let options = ["--target", "1,3", "--views", "2", "--network", "none", "--layers", "surface:1", "-o", &pictures];
    let rendered = json(&mut folders.liveview("render", &options));
    assert!((psnr("1,3") - rendered["mean"]["psnr"].as_f64().unwrap()).abs() < 1e-6);
}

#[test]
fn invalid_configurations_are_refused() {
    let folders = Folders::new();
    let refused = |arguments: &[&str], words: &[&str]| folders.assert_refused(&mut sweep(&folders, arguments), words);
    refused(&["--layers", "guessed:4"], &["guessed:4", "guided:L"]);
    refused(&["--layers", "planes:0"], &["planes:0", "from 1 to 4096"]);
    // Commas separate configurations: a list of disparities is several of them.
    refused(&["--layers", "list:0.5,0.25"], &["--layers", "\"0.25\" is not a choice of layers"]);
    refused(&["--near", "9", "--far", "3"], &["0 < near < far"]);
    let mut unknown = folders.liveview("sweep", &["--target", "nobody", "-o", &folders.out("report")]);
    folders.assert_refused(&mut unknown, &["nobody"]);
}
