//! ONNX Runtime is missing.

mod common;

use common::{Folders, fixture};

/// A binary elsewhere does not find the wheel of this checkout. The test has a binary to itself: if
/// another test forked while the copy is open for writing, running the copy would fail with "text
/// file busy".
#[test]
fn missing_library_with_the_engine_is_an_error() {
    let folders = Folders::new();
    let binary = tempfile::tempdir().unwrap();
    let copy = binary.path().join("liveview");
    std::fs::copy(env!("CARGO_BIN_EXE_liveview"), &copy).unwrap();
    let mut render = assert_cmd::Command::new(copy);
    render.current_dir(binary.path()).env_remove("ORT_DYLIB_PATH").arg("render").arg(folders.scene());
    render.args(["--target", "2", "--engine", "openvino", "--model", &fixture("tiny_v4"), "-o", &folders.out("a.png")]);
    folders.assert_refused(
        &mut render,
        &["execution provider openvino", "looked in", ".venv-openvino", "make setup WITH=openvino"],
    );
}
