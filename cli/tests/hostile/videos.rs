//! Videos that ffmpeg does not write completely, as on a full disk: an error, and the file of that
//! name stays.

use std::fs;

use assert_cmd::Command;

use crate::common::Folders;
use crate::common::rig::Rig;

/// What ffmpeg does in place of copying its input to the file, and parts of the message.
const FAULTS: [(&str, &str); 4] = [
    ("/bin/cat > \"$last\"; echo 'Error writing trailer: No space left on device' >&2", "No space left on device"),
    ("/usr/bin/head -c 20000 > \"$last\"; /bin/cat > /dev/null", "ffmpeg wrote 3 frames; expected 4"),
    ("{ /bin/cat; /usr/bin/head -c 9216 /dev/zero; } > \"$last\"", "ffmpeg wrote 5 frames; expected 4"),
    ("/bin/cat > /dev/null; /bin/rm \"$last\"", "the video that ffmpeg wrote cannot be read"),
];

#[test]
fn incomplete_video_is_an_error_and_the_earlier_one_stays() {
    let (folders, rig) = (Folders::new(), Rig::new(4));
    let path = ["--network", "none", "--threads", "1", "--path", "line:4"];
    for name in ["a.mp4", "a.gif"] {
        for (script, words) in FAULTS {
            let script = format!("for last; do :; done; {script}");
            let refused = |folders: &Folders, mut command: Command| {
                let film = folders.out(name);
                fs::write(&film, "an earlier video").unwrap();
                let output = command.args(["-o", &film]).env("PATH", folders.ffmpeg(&script)).output().unwrap();
                let stderr = String::from_utf8(output.stderr).unwrap();
                assert_eq!(output.status.code(), Some(2), "{command:?}: {stderr}");
                assert!(stderr.contains(&format!("error: -o {film}: ")) && stderr.contains(words), "{words}: {stderr}");
                assert_eq!(
                    (fs::read(&film).unwrap(), folders.written()),
                    (b"an earlier video".into(), vec![name.into()])
                );
                fs::remove_file(&film).unwrap();
            };
            refused(&folders, folders.liveview("render", &path));
            refused(&rig.folders, rig.video(&["--camera", "cam2"]));
        }
    }
}
