"""Renders a held-out photo of a scene from its neighbours, compares the two, and plots them if
matplotlib is installed.

python compare.py SCENE [FOLDER]
"""

# %% The scene, and the picture. `progress` is called for each photo whose depth is searched; with
# tqdm: bar = tqdm(total=count); progress=lambda *_: bar.update()
import sys

import liveview
import numpy as np

folder, out = [*sys.argv[1:], "."][:2]
scene = liveview.Scene(folder, width=252)
target = next(name for name in scene.names if name.startswith("target"))
synthesizer = liveview.Synthesizer(
    scene, progress=lambda done, count, name: print(f"depth of photo {done + 1} of {count}: {name}")
)
frame = synthesizer.render(target)
frame.save(f"{out}/target_0.png")

# %% The comparison: the metrics take [3, h, w], as the reference's.
truth = scene.photo(target)
planes = [np.moveaxis(picture, -1, 0) for picture in (frame.picture, truth)]
print(f"PSNR {liveview.psnr(*planes):.2f} dB, SSIM {liveview.ssim(*planes):.3f}")
print(", ".join(f"{stage} {1e3 * seconds:.0f} ms" for stage, seconds in frame.times.items()))

# %% The plot.
try:
    import matplotlib.pyplot as plt
except ImportError:
    print("matplotlib is not installed: no plot")
else:
    figure, axes = plt.subplots(2, 2, figsize=(10, 7))
    difference = np.clip(4 * np.abs(frame.picture - truth), 0, 1)
    shown = {"photo": truth, "picture": frame.picture, "4 x difference": difference, "disparity": frame.disparity}
    for axis, (title, values) in zip(axes.flat, shown.items(), strict=True):
        axis.imshow(values)
        axis.set(title=title, xticks=[], yticks=[])
    figure.savefig(f"{out}/compare.png")
