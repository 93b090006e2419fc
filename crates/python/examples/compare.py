"""Renders a held-out photo of a scene from its neighbours, compares the two, and plots them if
matplotlib is installed.
"""

# %% The scene, and the picture. `progress` is called for each photo whose depth is searched; with
# tqdm: bar = tqdm(total=count); progress=lambda *_: bar.update()
import argparse

import liveview
import numpy as np

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("scene", help="folder of a scene")
parser.add_argument("folder", nargs="?", default=".", help="of the picture and the plot; by default the current one")
arguments = parser.parse_args()
scene, out = liveview.Scene(arguments.scene, width=252), arguments.folder
target = next((name for name in scene.names if name.startswith("target")), scene.names[0])
synthesizer = liveview.Synthesizer(
    scene, progress=lambda done, count, name: print(f"depth of photo {done + 1} of {count}: {name}")
)
frame = synthesizer.render(target)
frame.save(f"{out}/picture.png")

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
