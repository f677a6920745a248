"""Image-Based Gaussian Splatting: load a scene, train a model, render new views, in numpy arrays.

>>> import ibgs
>>> scene = ibgs.Scene.load("my-scene", eval=True)
>>> ibgs.Trainer(scene, "output/my-scene").run()
>>> model = ibgs.Model.open("output/my-scene")
>>> image = model.render(model.views[0])["final"]

Shapes, units and errors stand in the stubs beside this file; the options of a training are those of docs/config.md.
"""

from ._ibgs import (
    Camera,
    Error,
    Gaussians,
    Model,
    Progress,
    Scene,
    Trainer,
    View,
    __version__,
    defaults,
    psnr,
    run,
    ssim,
    to_uint8,
)

__all__ = [
    "Camera",
    "Error",
    "Gaussians",
    "Model",
    "Progress",
    "Scene",
    "Trainer",
    "View",
    "__version__",
    "defaults",
    "psnr",
    "run",
    "ssim",
    "to_uint8",
]
