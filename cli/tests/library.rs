//! ONNX Runtime is not where the program looks.

mod common;

use common::{Folders, fixture};

/// A binary elsewhere finds no wheel of this checkout. Here, where no other test forks: a fork that inherits the copy while it
/// is open for writing makes it "text file busy".
#[test]
fn no_library_with_the_engine() {
    let folders = Folders::new();
    let binary = tempfile::tempdir().unwrap();
    let copy = binary.path().join("liveview");
    std::fs::copy(env!("CARGO_BIN_EXE_liveview"), &copy).unwrap();
    let mut render = assert_cmd::Command::new(copy);
    render.current_dir(binary.path()).env_remove("ORT_DYLIB_PATH").arg("render").arg(folders.scene());
    render.args(["--target", "2", "--engine", "openvino", "--model", &fixture("tiny_v4"), "-o", &folders.out("a.png")]);
    folders.assert_refused(
        &mut render,
        &["execution provider openvino", "looked in", ".venv-openvino", "make runtime-openvino"],
    );
}
