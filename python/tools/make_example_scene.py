"""Make tests/scenes/workshop, the example scene: the still life of its scene.py, path-traced
with Mitsuba 3.

Usage, in python/:
    python -m tools.make_example_scene [--spp N]           render everything (needs mitsuba)
    python -m tools.make_example_scene --preview out.png   render target_0 alone
    python -m tools.make_example_scene --check             reproject the depth on disk
"""

import argparse
import json
import runpy
from pathlib import Path

import numpy as np
from PIL import Image

from liveview_ref.data.image import to_u8

W, H = 504, 352
FOCAL = W / 2 / np.tan(np.radians(55 / 2))
DELTA_MAX = 1.0  # disparity of the value 65535 in the depth PNGs
OUT = Path(__file__).resolve().parents[2] / "tests" / "scenes" / "workshop"


def turn(axis, angle):
    """Rotation about a coordinate axis."""
    k = np.cross(np.eye(3), np.eye(3)[axis])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def rig():
    """name -> cam_from_world (R, t): an irregular hexagon with a centre, as if hand-held, and two
    targets inside it."""
    rng = np.random.default_rng(3)
    around = np.radians(np.arange(6) * 60 + 12)
    centres = np.vstack([[0, 0], 0.1 * np.stack([np.cos(around), np.sin(around)], 1), [0.047, 0.022], [-0.04, 0.041]])
    names = [f"source_{k}" for k in range(7)] + ["target_0", "target_1"]
    views = {}
    for name, (x, y) in zip(names, centres, strict=True):
        jitter = rng.uniform(-1, 1, 6) * (0.012, 0.012, 0.02, 2.0, 2.0, 1.6) * (1 if "source" in name else 0.5)
        pitch, yaw, roll = np.radians(jitter[3:] + (10, 0, 0))  # the rig looks down by 10 degrees
        r = turn(2, roll) @ turn(0, pitch) @ turn(1, yaw)
        views[name] = r, -r @ (np.array([x, y, 0]) + jitter[:3])
    return views


def sensor(mi, pose, spp):
    """A Mitsuba camera; its own axes are x left, y up, z forward."""
    r, t = pose
    world_from_cam = np.vstack([np.column_stack([r.T @ np.diag([-1, -1, 1]), -r.T @ t]), [0, 0, 0, 1]])
    film = {"type": "hdrfilm", "width": W, "height": H, "rfilter": {"type": "gaussian", "stddev": 0.42}}
    film |= {"pixel_format": "rgb", "component_format": "float32"}
    sampler = {"type": "multijitter", "sample_count": spp}
    lens = {"fov": 55.0, "fov_axis": "x", "near_clip": 0.01, "to_world": mi.ScalarTransform4f(world_from_cam)}
    return mi.load_dict({"type": "perspective", "film": film, "sampler": sampler, **lens})


def photo(mi, scene, pose, spp, seed):
    """8-bit sRGB, with a soft shoulder above 0.7."""
    path = mi.load_dict({"type": "path", "max_depth": 5})
    x = np.array(mi.render(scene, sensor=sensor(mi, pose, spp), integrator=path, spp=spp, seed=seed))[..., :3]
    x = np.where(x < 0.7, x, 0.7 + 0.3 * np.tanh((x - 0.7) / 0.3))
    x = np.where(x < 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)
    return to_u8(x)


def rays(pose):
    """Camera centre and a world-space ray through every pixel centre [H, W, 3], of length 1 along
    the camera's z."""
    r, t = pose
    y, x = np.mgrid[0:H, 0:W] + 0.5
    return -r.T @ t, np.stack([(x - W / 2) / FOCAL, (y - H / 2) / FOCAL, np.ones_like(x)], -1) @ r


def disparity(mi, scene, pose):
    """1 / z at every pixel centre, as 16-bit codes."""
    origin, d = rays(pose)
    length = np.linalg.norm(d, axis=-1)
    unit = (d / length[..., None]).reshape(-1, 3).tolist()
    start = origin.tolist()
    t = np.array([scene.ray_intersect_preliminary(mi.Ray3f(start, k)).t for k in unit]).reshape(H, W)
    return (length / t * (65535 / DELTA_MAX) + 0.5).astype(np.uint16)


def project(pose, p):
    """World points [..., 3] to pixel coordinates [..., 2] and z."""
    q = p @ pose[0].T + pose[1]
    return q[..., :2] / q[..., 2:] * FOCAL + (W / 2, H / 2), q[..., 2]


def visible(delta, uv, z):
    """Whether the depth test passes, and the pixels tested."""
    inside = (uv >= 0.5).all(-1) & (uv <= (W - 0.5, H - 0.5)).all(-1) & (z > 0)
    j, i = np.where(inside[..., None], uv, 0.5).astype(int).T
    return inside & (np.abs(z * delta[i.T, j.T] - 1) < 0.005), (i.T, j.T)


def tracks(views, deltas, photos):
    """About 300 points on texture: position, colour, and {view: pixel} of the views that see it by
    the depth test."""
    found = []
    for name, image in ((k, v / 255.0) for k, v in photos.items() if "source" in k):
        delta, (origin, ray) = deltas[name], rays(views[name])
        gy, gx = np.gradient(image.mean(-1))
        near = [np.roll(delta, k, (0, 1)) for k in np.ndindex(3, 3)]
        flat = np.roll(np.ptp(near, 0) < 0.01 * delta, (-1, -1), (0, 1))
        score = np.where(flat, np.hypot(gy, gx), 0)
        for i, j in np.ndindex(6, 8):
            a, b = H * i // 6 + 2, W * j // 8 + 2
            at = np.unravel_index(score[a : a + 54, b : b + 59].argmax(), (54, 59)) + np.array([a, b])
            p = origin + ray[tuple(at)] / delta[tuple(at)]
            seen = {}
            for other, pose in views.items():
                uv, z = project(pose, p)
                if visible(deltas[other], uv, z)[0]:
                    seen[other] = uv
            if len(seen) >= 3 and score[tuple(at)] > 0:
                found.append((p, photos[name][tuple(at)], seen))
    return found


def write_colmap(folder, views, files, points):
    """COLMAP text: cameras.txt, images.txt, points3D.txt."""
    folder.mkdir(parents=True, exist_ok=True)
    cam = f"# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy\n1 PINHOLE {W} {H} {FOCAL:.9f} {FOCAL:.9f} {W / 2} {H / 2}\n"
    (folder / "cameras.txt").write_text(cam)
    images = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then X Y POINT3D_ID ...; cam_from_world"]
    lines = [[str(k + 1), *(f"{x:.9f}" for x in p), *map(str, c)] for k, (p, c, _) in enumerate(points)]
    errors = [[] for _ in points]
    for n, (name, (r, t)) in enumerate(views.items(), 1):
        w = np.sqrt(1 + np.trace(r)) / 2
        xyz = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4 * w)
        images.append(f"{n} {' '.join(f'{x:.12f}' for x in (w, *xyz, *t))} 1 {files[name]}")
        seen = [(k, seen[name]) for k, (_, _, seen) in enumerate(points) if name in seen]
        images.append(" ".join(f"{uv[0]:.3f} {uv[1]:.3f} {k + 1}" for k, uv in seen))
        for m, (k, uv) in enumerate(seen):
            lines[k] += [str(n), str(m)]
            errors[k].append(np.linalg.norm(np.round(uv, 3) - uv))
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    rows = [" ".join([*x[:7], f"{np.mean(e):.6f}", *x[7:]]) for x, e in zip(lines, errors, strict=True)]
    head = "# POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
    (folder / "points3D.txt").write_text(head + "\n".join(rows) + "\n")


def check():
    """Reproject target_0 by its depth into each source, using only the files, and compare the
    colours there."""
    views, photos, deltas = {}, {}, {}
    scale = json.loads((OUT / "depth/scale.json").read_text())["delta_max"] / 65535
    for line in (OUT / "sparse/0/images.txt").read_text().splitlines()[1::2]:
        _, *pose, _, file = line.split()
        name, (w, x, y, z, *t) = Path(file).stem, map(float, pose)
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        views[name] = np.eye(3) + 2 * w * k + 2 * k @ k, np.array(t)
        photos[name] = np.asarray(Image.open(OUT / "images" / file)) / 255.0
        deltas[name] = np.asarray(Image.open(OUT / f"depth/{name}.png")) * scale
    origin, ray = rays(views["target_0"])
    p, colour = origin + ray / deltas["target_0"][..., None], photos["target_0"]
    print(f"disparity {deltas['target_0'].min():.3f} to {deltas['target_0'].max():.3f}; mean |difference| in [0, 1]")
    for name in (k for k in views if "source" in k):
        (uv, z), found = project(views[name], p), []
        seen = visible(deltas[name], uv, z)[0]
        for shift in (0.0, 0.5):  # the second figure shows the effect of a shift by half a pixel
            f = np.clip(uv[seen] - 0.5 + shift, 0, (W - 1.001, H - 1.001))
            (j, i), (a, b) = f.astype(int).T, (f % 1).T[..., None]
            s = photos[name]
            there = (s[i, j] * (1 - a) + s[i, j + 1] * a) * (1 - b) + (s[i + 1, j] * (1 - a) + s[i + 1, j + 1] * a) * b
            found.append(np.abs(there - colour[seen]).mean())
        shift = np.linalg.norm(views[name][1] - views[name][0] @ views["target_0"][0].T @ views["target_0"][1])
        span = (FOCAL * shift * np.quantile(deltas["target_0"], (0, 1))).round(1)
        print(f"{name}: {seen.mean():.1%} seen, {found[0]:.4f} (half a pixel off {found[1]:.4f}), moves by {span} px")
        assert found[0] < 0.03 and found[0] < found[1], name


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--spp", type=int, default=256, help="samples per pixel")
    ap.add_argument("--preview", type=Path, help="render target_0 into this file only")
    ap.add_argument("--check", action="store_true", help="only check the files on disk")
    args = ap.parse_args()
    if args.check:
        return check()
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    scene, views = runpy.run_path(str(OUT / "scene.py"))["build"](mi), rig()
    if args.preview:
        return Image.fromarray(photo(mi, scene, views["target_0"], args.spp, 0)).save(args.preview)
    (OUT / "images").mkdir(parents=True, exist_ok=True)
    (OUT / "depth").mkdir(exist_ok=True)
    deltas = {name: disparity(mi, scene, pose) for name, pose in views.items()}
    for name, delta in deltas.items():
        Image.fromarray(delta).save(OUT / f"depth/{name}.png", optimize=True)
    unit = "1 / scene unit; disparity = value * delta_max / 65535 = 1 / z at the pixel centre, z along the camera axis"
    (OUT / "depth/scale.json").write_text(json.dumps({"delta_max": DELTA_MAX, "unit": unit}, indent=1) + "\n")
    photos, files = {}, {name: name + ".jpg" for name in views}
    for seed, (name, pose) in enumerate(views.items()):
        photos[name] = photo(mi, scene, pose, args.spp, seed)
        Image.fromarray(photos[name]).save(OUT / "images" / files[name], quality=95, subsampling=0, optimize=True)
        print(name, flush=True)
    points = tracks(views, {k: v * (DELTA_MAX / 65535) for k, v in deltas.items()}, photos)
    write_colmap(OUT / "sparse/0", views, files, points)
    print(len(points), "points, mean track", np.mean([len(seen) for *_, seen in points]))
    check()


if __name__ == "__main__":
    main()
