//! `render --shard` and `join`: the pictures are those of a single run, for any number of shards
//! and after killed processes.
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

use crate::common::{COPIES, Folders, wait_until};

const NO_NETWORK: [&str; 2] = ["--network", "none"];

fn render(folders: &Folders, arguments: &[&str]) -> Command {
    let mut render = Command::new(env!("CARGO_BIN_EXE_liveview"));
    for variable in ["SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX", "LIVEVIEW_SHARDS"] {
        render.env_remove(variable);
    }
    render.arg("render").arg(folders.scene()).args(NO_NETWORK).args(["--threads", "1"]).args(arguments);
    render.stdout(Stdio::piped()).stderr(Stdio::piped());
    render
}

fn join(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_liveview")).arg("join").args(arguments).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn succeeds(output: Output) -> String {
    assert!(output.status.success(), "{}", stderr(&output));
    String::from_utf8(output.stdout).unwrap()
}

fn assert_refused(output: &Output, words: &[&str]) {
    let stderr = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    for word in words {
        assert!(stderr.contains(word), "\"{word}\" is missing in: {stderr}");
    }
}

/// The pictures of a folder by name, without the temporary files of killed processes.
fn pictures(folder: &str) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let named = files.filter(|file| !file.file_name().unwrap().to_str().unwrap().starts_with(".liveview-tmp-"));
    let pictures = named.filter(|file| file.extension().is_some_and(|extension| extension == "png"));
    pictures.map(|file| (file.file_name().unwrap().to_str().unwrap().to_owned(), fs::read(file).unwrap())).collect()
}

#[test]
fn sixteen_shards_write_the_pictures_of_one_run() {
    let folders = Folders::new();
    let path = ["--path", "circle:64", "--layers", "surface:1"];
    let (whole, parts) = (folders.out("whole"), folders.out("parts"));
    succeeds(render(&folders, &[&path[..], &["-o", &whole]].concat()).output().unwrap());
    let shard =
        |shard: String| render(&folders, &[&path[..], &["-o", &parts, "--shard", &shard]].concat()).spawn().unwrap();
    // All at the same time, into one folder.
    let running: Vec<Child> = (1..=16).map(|index| shard(format!("{index}/16"))).collect();
    for child in running {
        let output = child.wait_with_output().unwrap();
        let report = stderr(&output);
        assert!(!report.contains("other pictures"), "pictures of other shards belong to the job: {report}");
        assert!(succeeds(output).contains("/16: 4 of 64 pictures"));
    }
    let (expected, found) = (pictures(&whole), pictures(&parts));
    assert_eq!(expected.len(), 64);
    assert!(expected == found, "byte for byte");
    let different = expected.values().collect::<std::collections::BTreeSet<_>>();
    assert!(different.len() > 32, "frames differ from one another");
    assert!(!Path::new(&folders.out("parts/liveview.json")).exists());
    assert!(succeeds(join(&[&parts])).contains("64 pictures of 16 shards, complete"));
}

#[test]
fn killed_shard_is_completed_by_resume() {
    let folders = Folders::new();
    let path = ["--path", "spiral:240", "--width", "32"];
    let (whole, parts) = (folders.out("whole"), folders.out("parts"));
    succeeds(render(&folders, &[&path[..], &["-o", &whole]].concat()).output().unwrap());
    let shard =
        |shard: &str, more: &[&str]| render(&folders, &[&path[..], &["-o", &parts, "--shard", shard], more].concat());
    succeeds(shard("1/3", &[]).output().unwrap());
    assert_refused(
        &join(&[&parts]),
        &["160 of 240", "shard 2/3 has no record", "80 pictures (frame_0001 first)", "3/3"],
    );

    for kill_after in ["liveview_2_of_3.json", "frame_0031.png"] {
        let mut killed = shard("2/3", &["--resume"]).spawn().unwrap();
        wait_until(&mut killed, || Path::new(&parts).join(kill_after).exists());
        killed.kill().unwrap();
        assert!(!killed.wait().unwrap().success());
    }
    succeeds(shard("3/3", &["--resume"]).output().unwrap());
    assert_refused(&join(&[&parts]), &["shard 2/3 lacks", "with --resume"]);
    let again = shard("2/3", &["--resume"]).output().unwrap();
    assert!(stderr(&again).contains("of 80 pictures are kept"), "{}", stderr(&again));
    succeeds(again);
    let (expected, found) = (pictures(&whole), pictures(&parts));
    let different: Vec<_> = found.keys().filter(|name| expected.get(*name) != found.get(*name)).collect();
    assert!(expected == found, "{} and {} pictures, different: {different:?}", expected.len(), found.len());
    succeeds(join(&[&parts]));

    fs::write(folders.out("parts/frame_0002.png"), "another").unwrap();
    assert_refused(&join(&[&parts]), &["1 of 240", "shard 3/3 lacks 1 picture (frame_0002 first)"]);
    succeeds(shard("3/3", &["--resume"]).output().unwrap());
    succeeds(join(&[&parts]));
}

#[test]
fn every_shard_uses_the_planes_of_the_first_frame() {
    let folders = Folders::new();
    let render = |arguments: &[&str]| {
        let path = ["--path", "line:5", "--layers", "select:2/8"];
        folders.render(&[&path, arguments].concat()).assert().success();
    };
    let (whole, parts) = (folders.out("whole"), folders.out("parts"));
    render(&["-o", &whole]);
    (1..=2).for_each(|index| render(&["-o", &parts, "--shard", &format!("{index}/2")]));
    assert!(pictures(&whole) == pictures(&parts));
}

#[test]
fn join_computes_mean_scores_from_several_folders() {
    let folders = Folders::new();
    let heldout = ["--heldout", "2", "--views", "2"];
    let (whole, table) = (folders.out("whole"), folders.out("scores.json"));
    let one = render(&folders, &[&heldout[..], &["-o", &whole, "--json"]].concat()).output().unwrap();
    let one: Value = serde_json::from_str(&succeeds(one)).unwrap();
    // With more shards than photos, the last shards report 0 pictures.
    let parts: Vec<String> = (1..=5).map(|index| folders.out(&format!("machine_{index}"))).collect();
    for (at, folder) in parts.iter().enumerate() {
        let shard = format!("{}/5", at + 1);
        let output = render(&folders, &[&heldout[..], &["-o", folder, "--shard", &shard]].concat()).output().unwrap();
        assert!(succeeds(output).contains(if at < 3 { "1 of 3 pictures" } else { "0 of 3 pictures" }));
    }
    let all: Vec<&str> = parts.iter().map(String::as_str).collect();
    let text = succeeds(join(&[&all[..], &["-o", &table]].concat()));
    assert!(text.contains("mean") && text.contains("3 pictures of 5 shards"), "{text}");
    let joined: Value = serde_json::from_slice(&fs::read(&table).unwrap()).unwrap();
    assert_eq!(joined["mean"], one["mean"]);
    for (a, b) in joined["targets"].as_array().unwrap().iter().zip(one["targets"].as_array().unwrap()) {
        for key in ["name", "psnr", "ssim", "layers", "uncovered_share", "disparity_max"] {
            assert_eq!(a[key], b[key], "{key}");
        }
    }
    assert_refused(&join(&all[1..]), &["1 of 3 pictures", "shard 1/5 has no record"]);
}

#[test]
fn joined_video_equals_that_of_one_run() {
    let folders = Folders::new();
    let path = folders.ffmpeg(COPIES);
    let (whole, parts, joined) = (folders.out("whole.mp4"), folders.out("parts"), folders.out("joined.mp4"));
    let frames = ["--path", "line:5"];
    succeeds(render(&folders, &[&frames[..], &["-o", &whole]].concat()).env("PATH", &path).output().unwrap());
    for shard in ["1/2", "2/2"] {
        succeeds(render(&folders, &[&frames[..], &["-o", &parts, "--shard", shard]].concat()).output().unwrap());
    }
    let mut join = Command::new(env!("CARGO_BIN_EXE_liveview"));
    succeeds(join.args(["join", &parts, "-o", &joined]).env("PATH", &path).output().unwrap());
    let frames = fs::read(&joined).unwrap();
    assert_eq!(frames.len(), 5 * 64 * 48 * 3);
    assert!(frames == fs::read(&whole).unwrap());
}

#[test]
fn shard_auto_reads_the_schedulers_variables() {
    let folders = Folders::new();
    let parts = folders.out("parts");
    let auto = || render(&folders, &["--path", "line:4", "-o", &parts, "--shard", "auto"]);
    assert_refused(&auto().output().unwrap(), &["SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX", "expected one"]);
    let kubernetes = auto().env("JOB_COMPLETION_INDEX", "1").env("LIVEVIEW_SHARDS", "2").output().unwrap();
    assert!(succeeds(kubernetes).contains("shard   2/2: 2 of 4 pictures"));
    let slurm = [("SLURM_ARRAY_TASK_ID", "4"), ("SLURM_ARRAY_TASK_MIN", "4"), ("SLURM_ARRAY_TASK_COUNT", "2")];
    assert!(succeeds(auto().envs(slurm).output().unwrap()).contains("shard   1/2: 2 of 4 pictures"));
    succeeds(join(&[&parts]));
}

#[test]
fn job_files_of_slurm_and_kubernetes_run() {
    let folders = Folders::new();
    let deploy = Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy");
    let parts = folders.out("parts");
    for task in ["0", "1"] {
        let mut script = Command::new("sh");
        script
            .arg(deploy.join("slurm_array.sh"))
            .arg(folders.scene())
            .args([&parts, "--path", "line:4"])
            .args(NO_NETWORK);
        script.env("LIVEVIEW", env!("CARGO_BIN_EXE_liveview")).env("LIVEVIEW_SHARDS", "2");
        // The variables of a task that is resubmitted alone.
        script.env("SLURM_ARRAY_TASK_ID", task).env("SLURM_ARRAY_TASK_MIN", task).env("SLURM_ARRAY_TASK_COUNT", "1");
        succeeds(script.env_remove("JOB_COMPLETION_INDEX").output().unwrap());
    }
    assert!(succeeds(join(&[&parts])).contains("4 pictures of 2 shards"));

    let job = fs::read_to_string(deploy.join("kubernetes_job.yaml")).unwrap();
    let after =
        |key: &str| job.split(key).nth(1).unwrap().split_whitespace().next().unwrap().trim_matches('"').to_owned();
    assert_eq!(after("completions:"), after("name: LIVEVIEW_SHARDS\n              value:"));
    // The arguments of the job, with local folders.
    let list = job.split("args:").nth(1).unwrap().lines().map(str::trim);
    let words = list.skip(1).map_while(|line| line.strip_prefix("- "));
    let words = words.map(|word| match word {
        "/data/scene" => folders.scene().to_str().unwrap().to_owned(),
        word => word.replace("/data", &folders.out("")).replace("spiral:900", "spiral:32"),
    });
    let mut pod = Command::new(env!("CARGO_BIN_EXE_liveview"));
    pod.args(words).args(NO_NETWORK).env_remove("SLURM_ARRAY_TASK_ID");
    pod.env("JOB_COMPLETION_INDEX", "15").env("LIVEVIEW_SHARDS", after("completions:"));
    assert!(succeeds(pod.output().unwrap()).contains("shard   16/16: 2 of 32 pictures"));
}

#[test]
fn invalid_shards_and_records_of_different_jobs_are_errors() {
    let folders = Folders::new();
    let parts = folders.out("parts");
    let shard = |arguments: &[&str]| render(&folders, arguments).output().unwrap();
    let line = ["--path", "line:4", "-o", &parts];
    let refused = |arguments: &[&str], words: &[&str]| assert_refused(&shard(arguments), words);
    for wrong in ["0/2", "3/2", "2", "x"] {
        refused(&[&line[..], &["--shard", wrong]].concat(), &["--shard", "expected I/N"]);
    }
    let file = folders.out("a.png");
    refused(
        &["--path", "line:4", "--shard", "1/2", "-o", &folders.out("a.mp4")],
        &["--shard 1/2, -o", "expected a folder"],
    );
    refused(&["--target", "2", "--shard", "1/2", "-o", &file], &["--shard 1/2, -o", "a.png"]);
    refused(&["--target", "1,2", "--shard", "1/2", "-o", &parts, "--depth", &file], &["--shard 1/2, --depth", "a.png"]);
    refused(&["--heldout", "2", "--shard", "1/2"], &["--output"]);
    assert_eq!(folders.written(), Vec::<String>::new());

    assert_refused(&join(&[&folders.out("none")]), &["none", "cannot be read"]);
    fs::create_dir(&parts).unwrap();
    assert_refused(&join(&[&parts]), &["parts", "no record of a shard"]);
    succeeds(shard(&[&line[..], &["--shard", "1/2"]].concat()));
    let (other, third) = (folders.out("other"), folders.out("third"));
    succeeds(shard(&["--path", "line:4", "--layers", "planes:2", "-o", &other, "--shard", "2/2"]));
    assert_refused(
        &join(&[&parts, &other]),
        &["liveview_2_of_2.json", "another job", "\"layers\" is \"planes:2\", expected"],
    );
    succeeds(shard(&["--path", "line:4", "-o", &third, "--shard", "2/3"]));
    assert_refused(&join(&[&parts, &third]), &["one of 3 shards", "one of 2"]);
    let record = folders.out("parts/liveview_1_of_2.json");
    assert_refused(&join(&[&parts, "-o", &record]), &["would overwrite the record"]);
    assert_refused(&join(&[&parts, "-o", &file]), &["a.png", ".mp4, .gif or .json"]);
    fs::write(&record, "{}").unwrap();
    assert_refused(&join(&[&parts]), &["liveview_1_of_2.json", "shard is null", "expected an index"]);
}
