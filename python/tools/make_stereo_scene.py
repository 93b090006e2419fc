"""Write the Middlebury motorcycle pair (2014, from scikit-image's wheel) as a scene.

Usage, in python/: python -m tools.make_stereo_scene FOLDER

Two views 193 mm apart: an example of V = 2, for stereo rigs and passthrough. Scene unit: metre;
camera 0 is the world.
"""

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from skimage.data import stereo_motorcycle

from liveview_ref.data.opengl import flip_axes

FOCAL, CENTRE, SHIFT, BASELINE = 994.978, (311.193, 254.877), 31.086, 0.193001  # pixels, pixels, pixels, metres


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    left, right, disparity = stereo_motorcycle()
    seen = disparity[np.isfinite(disparity)]
    near, far = (FOCAL * BASELINE / (d + SHIFT) for d in (seen.max(), seen.min()))
    frames = []
    for name, image, x, shift in (("left", left, 0.0, 0.0), ("right", right, BASELINE, SHIFT)):
        Image.fromarray(image).save(folder / f"{name}.png")
        pose = np.eye(4)  # world from camera
        pose[0, 3] = x
        # Half a pixel, because pixel centres of the calibration are integers.
        frame = {
            "file_path": f"{name}.png",
            "transform_matrix": flip_axes(pose).tolist(),
            "cx": CENTRE[0] + shift + 0.5,
        }
        frames.append(frame)
    shared = {"w": left.shape[1], "h": left.shape[0], "fl_x": FOCAL, "fl_y": FOCAL, "cy": CENTRE[1] + 0.5}
    shared |= {"near": round(0.97 * float(near), 3), "far": round(1.03 * float(far), 3)}
    (folder / "transforms.json").write_text(json.dumps(shared | {"frames": frames}, indent=1))


if __name__ == "__main__":
    main()
