"""Camera poses of photos by COLMAP, as `liveview poses` and `liveview.poses` run it.

    python _poses.py SCENE PHOTOS|VIDEO…

Photos are linked into SCENE/images (those that LiveView does not read are converted), frames of
videos are chosen and written there, and the model goes to SCENE/sparse/0. COLMAP is the package
pycolmap, else the program colmap. Progress and the result are lines of JSON on standard output;
COLMAP's own log is SCENE/colmap.log."""

import itertools
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import threading
from pathlib import Path

READ = {".jpg", ".jpeg", ".jfif", ".png", ".webp", ".tif", ".tiff", ".bmp"}
CONVERTED = {".heic", ".heif", ".avif", ".dng", ".jp2", ".gif"}
VIDEOS = {".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".insv", ".360"}
MAX_FRAMES = 60  # of all videos; also the most photos of which every pair is matched
NEIGHBOURS = 10  # photos before and after that each photo is matched with, where there are more
MAX_SIDE, MAX_FEATURES = 1600, 4096  # of a photo for its features, pixels
MIN_MATCHES = 15  # matches of two photos that count


class Refused(ValueError):
    """What is wrong with the input, and what was expected."""


def poses(inputs, scene, report=lambda **line: None):
    """Finds the poses of photos and frames of videos, and makes a scene folder of them.

    inputs: photos, folders of photos, videos. scene: a new folder, or an empty one.
    report(step=…, done=…, of=…) is called as it goes on. Returns photos (how many there are),
    registered, left_out (name → why), notes."""
    scene = Path(scene)
    if scene.exists() and (not scene.is_dir() or any(scene.iterdir())):
        raise Refused(f"{scene}: exists; expected a new folder or an empty one")
    work = scene.parent / f".liveview-tmp-{scene.name}-{os.getpid()}"
    try:
        (work / "images").mkdir(parents=True)
        notes = gather([Path(path) for path in inputs], work / "images", report)
        names = sorted(str(path.relative_to(work / "images")) for path in files_in(work / "images"))
        if len(names) < 3:
            raise Refused(f"{len(names)} photos; expected 3 or more, or a video")
        with quiet(work / "colmap.log"):
            features_and_matches(work, names, report)
            registered = mapping(work, report, len(names))
        if len(registered) < 3:
            raise Refused(f"no poses found for {len(names)} photos; {advice(work, names, registered)}")
        left_out = why_left_out(work / "database.db", names, registered)
        write_transforms(work, registered)
        for path in work.glob("database.db*"):
            path.unlink()
        (work / "pairs.txt").unlink()
        if scene.exists():
            scene.rmdir()
        work.rename(scene)
        return {"photos": len(names), "registered": len(registered), "left_out": left_out, "notes": notes}
    finally:
        shutil.rmtree(work, ignore_errors=True)


def advice(work, names, registered):
    why = why_left_out(work / "database.db", names, registered)
    return "; ".join(f"{name}: {reason}" for name, reason in list(why.items())[:3])


def files_in(folder):
    paths = (Path(root) / name for root, _, names in os.walk(folder, followlinks=True) for name in names)
    return sorted(path for path in paths if not path.name.startswith("."))


def gather(inputs, images, report):
    """Puts the photos and frames into the folder images."""
    notes, videos, photos = [], [], []
    for path in inputs:
        if path.is_dir():
            photos += [
                (found, found.relative_to(path)) for found in files_in(path) if suffix(found) in READ | CONVERTED
            ]
        elif not path.exists():
            raise Refused(f"{path}: does not exist; expected photos, a folder of photos, or a video")
        elif suffix(path) in VIDEOS:
            videos.append(path)
        else:
            photos.append((path, Path(path.name)))
    unread = []
    for done, (path, name) in enumerate(photos):
        report(step="photos", done=done, of=len(photos))
        # COLMAP's list of pairs is divided by spaces.
        target = images / re.sub(r"\s", "_", str(name))
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() or target.with_suffix(".jpg").exists():
            raise Refused(f"{path}: another photo has the same name; expected one folder of photos, or other names")
        if suffix(path) in READ:
            link(path, target)
        elif not convert(path, target.with_suffix(".jpg")):
            unread.append(str(name))
    if unread and len(unread) == len(photos):
        raise Refused(
            f"{unread[0]}: cannot be converted here; `pip install pillow-heif`, ImageMagick or ffmpeg would do it"
        )
    notes += [f"{name} is left out: it cannot be converted here" for name in unread]
    for video in videos:
        notes.append(frames_of(video, images, MAX_FRAMES // len(videos), len(videos) > 1, report))
    if not photos and not videos:
        raise Refused("no photos found; expected photos, a folder of photos, or a video")
    return notes


def suffix(path):
    return path.suffix.lower()


def link(path, target):
    try:
        target.symlink_to(path.resolve())
    except OSError:  # Windows allows it to few users
        shutil.copy2(path, target)


def convert(path, target):
    """A photo of another format as a JPEG; whether this machine can."""
    try:
        from PIL import Image, ImageOps

        if suffix(path) in {".heic", ".heif"}:
            import pillow_heif

            pillow_heif.register_heif_opener()
        with Image.open(path) as photo:
            ImageOps.exif_transpose(photo).convert("RGB").save(target, quality=95, exif=upright_exif(photo))
        return True
    except Exception:
        target.unlink(missing_ok=True)
    for command in (
        ["magick", path, "-auto-orient", "-quality", "95", target],
        ["heif-convert", "-q", "95", path, target],
        ["sips", "-s", "format", "jpeg", path, "--out", target],
        ["ffmpeg", "-v", "error", "-i", path, target],
    ):
        if (
            shutil.which(command[0])
            and subprocess.run(command, capture_output=True).returncode == 0
            and target.exists()
        ):
            return True
    return False


def upright_exif(photo):
    """The EXIF data, with its focal length, of a photo that was turned upright."""
    exif = photo.getexif()
    exif.pop(0x0112, None)
    return exif


def frames_of(video, images, count, is_one_of_several, report):
    """Writes at most so many frames of a video: between steps of equal motion the sharpest."""
    import numpy as np

    if not shutil.which("ffmpeg"):
        raise Refused(f"{video}: ffmpeg is not on the PATH; expected it for videos")
    report(step="frames of the video", done=0, of=count)
    width, height = 192, 108
    probe = subprocess.run(["ffmpeg", "-i", video], capture_output=True, text=True, errors="replace").stderr
    length = re.search(r"Duration: (\d+):(\d+):([\d.]+)", probe)
    seconds = (
        sum(float(part) * 60**power for part, power in zip(length.groups(), (2, 1, 0), strict=True)) if length else 60
    )
    rate = f"{min(15.0, max(0.5, 900 / max(seconds, 1))):.3f}"
    decoded = ffmpeg(video, f"fps={rate},scale={width}:{height}", "-f", "rawvideo", "-pix_fmt", "gray", "-")
    small = np.frombuffer(decoded.stdout, np.uint8)
    small = small[: small.size // (width * height) * width * height].reshape(-1, height, width).astype(np.float32)
    if len(small) < 3:
        raise Refused(
            f"{video}: not a video of 3 or more frames: {decoded.stderr.decode(errors='replace').strip()[-200:]}"
        )
    laplacian = (
        4 * small[:, 1:-1, 1:-1] - small[:, :-2, 1:-1] - small[:, 2:, 1:-1] - small[:, 1:-1, :-2] - small[:, 1:-1, 2:]
    )
    sharpness = laplacian.var(axis=(1, 2))
    motion = np.concatenate([[0], np.abs(np.diff(small, axis=0)).mean(axis=(1, 2))]) + 1e-3
    step = np.minimum((np.cumsum(motion) / motion.sum() * count).astype(int), count - 1)
    chosen = [max(np.flatnonzero(step == k), key=lambda frame: sharpness[frame]) for k in np.unique(step)]
    select = "+".join(f"eq(n\\,{frame})" for frame in chosen)
    prefix = f"{video.stem}_" if is_one_of_several else "frame_"
    files = "-fps_mode", "passthrough", "-q:v", "2", images / f"{prefix}%04d.jpg"
    written = ffmpeg(video, f"fps={rate},select='{select}'", *files)
    if written.returncode:
        raise Refused(f"{video}: ffmpeg: {written.stderr.decode(errors='replace').strip()[-300:]}")
    return f"{len(chosen)} frames of {video.name}, chosen by sharpness and motion"


def ffmpeg(video, filters, *output):
    return subprocess.run(["ffmpeg", "-v", "error", "-i", video, "-vf", filters, *output], capture_output=True)


class quiet:
    """Sends what COLMAP writes to standard error to a file."""

    def __init__(self, path):
        self.path = path

    def __enter__(self):
        sys.stderr.flush()
        self.before = os.dup(2)
        file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(file, 2)
        os.close(file)

    def __exit__(self, *_):
        os.dup2(self.before, 2)
        os.close(self.before)


COUNT = """
import sqlite3, sys, time
while True:
    time.sleep(0.3)
    try:
        database = sqlite3.connect(f"file:{sys.argv[1]}?mode=ro", uri=True)
        print(database.execute(f"select count(*) from {sys.argv[2]}").fetchone()[0], flush=True)
        database.close()
    except sqlite3.Error:
        pass
"""


class counting:
    """Reports how many rows a table of the database has, while COLMAP fills it. Another process
    counts them: two libraries of SQLite in one process undo each other's locks."""

    def __init__(self, database, table, step, of, report):
        self.database, self.table, self.step, self.of, self.report = database, table, step, of, report

    def count(self):
        for line in self.process.stdout:
            self.report(step=self.step, done=int(line), of=self.of)

    def __enter__(self):
        self.report(step=self.step, done=0, of=self.of)
        command = [sys.executable, "-c", COUNT, self.database, self.table]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        threading.Thread(target=self.count, daemon=True).start()

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()


def colmap():
    """The package pycolmap; None where only the program is there."""
    try:
        import pycolmap

        return pycolmap
    except ImportError:
        if shutil.which("colmap"):
            return None
        raise Refused("neither pycolmap nor colmap is installed; `pip install pycolmap` gets it") from None


def run_colmap(command, **options):
    arguments = [str(part) for name, value in options.items() for part in (f"--{name.replace('__', '.')}", value)]
    subprocess.run(["colmap", command, *arguments], check=True, stdout=2)


def features_and_matches(work, names, report):
    pycolmap, database, images = colmap(), work / "database.db", work / "images"
    with counting(database, "keypoints", "features", len(names), report):
        # Photos of one size and lens share a camera.
        for group in groups(images, names):
            if pycolmap:
                options = pycolmap.FeatureExtractionOptions(max_image_size=MAX_SIDE)
                options.sift.max_num_features = MAX_FEATURES
                pycolmap.extract_features(
                    database, images, group, pycolmap.CameraMode.SINGLE, extraction_options=options
                )
            else:
                (work / "group.txt").write_text("\n".join(group) + "\n")
                run_colmap(
                    "feature_extractor",
                    database_path=database,
                    image_path=images,
                    image_list_path=work / "group.txt",
                    ImageReader__single_camera=1,
                    SiftExtraction__max_num_features=MAX_FEATURES,
                )
                (work / "group.txt").unlink()
    pairs = [(a, b) for a in range(len(names)) for b in range(a + 1, len(names)) if is_matched(a, b, len(names))]
    (work / "pairs.txt").write_text("".join(f"{names[a]} {names[b]}\n" for a, b in pairs))
    with counting(database, "two_view_geometries", "matches", len(pairs), report):
        if pycolmap:
            pycolmap.match_image_pairs(
                database, pairing_options=pycolmap.ImportedPairingOptions(match_list_path=work / "pairs.txt")
            )
        else:
            run_colmap("matches_importer", database_path=database, match_list_path=work / "pairs.txt")


def is_matched(a, b, count):
    """Every pair of a few photos; of many, neighbours, and every pair of some that are spread
    evenly (loops)."""
    every = -(-count // MAX_FRAMES)
    return b - a <= NEIGHBOURS or (a % every == 0 and b % every == 0)


def groups(images, names):
    """The names of photos that share a size and, by their EXIF data, a lens."""
    found = {}
    for name in names:
        key = None
        try:
            from PIL import Image

            with Image.open(images / name) as photo:
                lens = photo.getexif().get_ifd(0x8769)
                key = (photo.size, str(lens.get(0x920A)), str(lens.get(0xA434)))
        except ImportError:
            key = (images / name).parent
        except OSError:
            pass  # COLMAP says what is wrong with it
        found.setdefault(key, []).append(name)
    return found.values()


def mapping(work, report, count):
    """Finds the poses; keeps the largest model. Returns their poses. COLMAP begins with two photos
    that see their points at a wide angle; where that gives too little, at a smaller one."""
    pycolmap, database, images, best = colmap(), work / "database.db", work / "images", (0, None)
    for attempt, (angle, inliers) in enumerate(((16, 100), (4, 50), (1.5, 25))):
        models = work / f"models{attempt}"
        models.mkdir()
        if pycolmap:
            options = pycolmap.IncrementalPipelineOptions(min_model_size=3, random_seed=1)
            options.mapper.init_min_tri_angle, options.mapper.init_min_num_inliers = angle, inliers
            done = itertools.count(3)
            callback = lambda done=done: report(step="poses", done=next(done), of=count)  # noqa: E731
            pycolmap.incremental_mapping(database, images, models, options, next_image_callback=callback)
        else:
            report(step="poses", done=0, of=count)
            run_colmap(
                "mapper",
                database_path=database,
                image_path=images,
                output_path=models,
                Mapper__min_model_size=3,
                Mapper__init_min_tri_angle=angle,
                Mapper__init_min_num_inliers=inliers,
            )
        for model in models.iterdir():
            size = int.from_bytes((model / "images.bin").read_bytes()[:8], "little")
            best = max(best, (size, model), key=lambda one: one[0])
        if best[0] >= 0.8 * count:
            break
    registered = {}
    if best[1]:
        (work / "sparse").mkdir()
        best[1].rename(work / "sparse/0")
        registered = registered_in(work / "sparse/0")
    for models in work.glob("models*"):
        shutil.rmtree(models)
    return registered


def registered_in(model):
    """The poses in an images.bin, by name: cam_from_world as quaternion w x y z and translation,
    and the number of the camera."""
    data, found, at = (model / "images.bin").read_bytes(), {}, 8
    for _ in range(int.from_bytes(data[:8], "little")):
        *pose, camera = struct.unpack_from("<7dI", data, at + 4)
        end = data.index(b"\0", at + 64)
        found[data[at + 64 : end].decode()] = pose, camera
        at = end + 9 + 24 * int.from_bytes(data[end + 1 : end + 9], "little")
    return found


def write_transforms(scene, registered):
    """Writes transforms.json. LiveView reads it before sparse/0, and so finds the range of depths
    from the photos: COLMAP's points often miss the nearest things."""
    data, cameras = (scene / "sparse/0/cameras.bin").read_bytes(), {}
    for index in range(int.from_bytes(data[:8], "little")):
        number, model, width, height, f, cx, cy, k1 = struct.unpack_from("<IiQQ4d", data, 8 + 56 * index)
        assert model == 2, "SIMPLE_RADIAL"
        cameras[number] = {"fl_x": f, "fl_y": f, "cx": cx, "cy": cy, "w": width, "h": height, "k1": k1}
    frames = []
    for name, ((w, x, y, z, *t), camera) in sorted(registered.items()):
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        centre = [-sum(rows[i][j] * t[i] for i in range(3)) for j in range(3)]
        # World from camera with OpenGL's axes: y up, z backwards.
        matrix = [[rows[0][j], -rows[1][j], -rows[2][j], centre[j]] for j in range(3)] + [[0, 0, 0, 1]]
        frames.append({"file_path": f"images/{name}", "transform_matrix": matrix, **cameras[camera]})
    text = json.dumps({"camera_model": "SIMPLE_RADIAL", "frames": frames}, indent=1)
    (scene / "transforms.json").write_text(text)


READ_TABLES = """
import json, sqlite3, sys
database = sqlite3.connect(sys.argv[1])
print(json.dumps([database.execute(query).fetchall() for query in sys.argv[2:]]))
"""


def tables(database, *queries):
    command = [sys.executable, "-c", READ_TABLES, database, *queries]
    return json.loads(subprocess.run(command, capture_output=True, check=True).stdout)


def why_left_out(database, names, registered):
    """For each photo without a pose, why."""
    ids, rows = tables(
        database,
        "select image_id, name from images",
        f"select pair_id, rows from two_view_geometries where rows >= {MIN_MATCHES}",
    )
    ids = dict(ids)
    best = {name: {True: (0, ""), False: (0, "")} for name in names}
    for pair, matches in rows:
        # COLMAP's number of a pair of photos.
        first, second = ids.get(pair // 2147483647), ids.get(pair % 2147483647)
        for name, other in ((first, second), (second, first)):
            if name in best and other in best:
                kind = other in registered
                best[name][kind] = max(best[name][kind], (matches, other))
    why = {}
    for index, name in enumerate(names):
        if name in registered:
            continue
        (known, nearest), (others, _) = best[name][True], best[name][False]
        before = next((other for other in reversed(names[:index]) if other in registered), None)
        after = next((other for other in names[index + 1 :] if other in registered), None)
        if name not in ids.values():
            why[name] = "it cannot be read"
        elif not known and not others:
            why[name] = "too few matches with any photo: it is blurred, plain, or shows something else"
        elif not known:
            gap = " and ".join(filter(None, [before, after])) or "the others"
            why[name] = f"it matches only photos that are left out too: a gap between them and {gap}"
        else:
            why[name] = f"{known} matches with {nearest}, which are too few for a pose"
    return why


def main(scene, *inputs):
    def report(**line):
        print(json.dumps(line), flush=True)

    try:
        report(result=poses(inputs, scene, report))
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        text = str(error) if isinstance(error, Refused) else f"{type(error).__name__}: {error}"
        report(error=text)
        sys.exit(2)


if __name__ == "__main__":
    main(*sys.argv[1:])
