from os import PathLike
from typing import Any, Callable, Literal, Sequence, TypedDict, Union

import numpy as np
from numpy.typing import NDArray

__version__: str

Path = Union[str, PathLike[str]]
Output = Literal["final", "base", "residual", "depth", "normals", "visibility"]
Split = Literal["train", "test"]

class Error(RuntimeError):
    """What cannot be done, in the sentence of the command line: file, field, and what helps."""

class Camera:
    """A posed pinhole camera. View space: x right, y down, z forward. Pixel centres lie at +0.5.

    `rotation` takes world directions to view directions, `x_view = rotation @ x_world + translation`; focal lengths and principal
    point are in pixels, (x, y). The principal point is the image's centre where it is left out.
    """

    def __init__(
        self,
        width: int,
        height: int,
        focal: Sequence[float],
        rotation: Any,
        translation: Any,
        principal: Sequence[float] | None = None,
    ) -> None: ...
    @property
    def width(self) -> int:
        """In pixels."""
    @property
    def height(self) -> int:
        """In pixels."""
    @property
    def focal(self) -> tuple[float, float]:
        """x, y, in pixels."""
    @property
    def principal(self) -> tuple[float, float]:
        """x, y, in pixels from the upper left corner of the image."""
    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rows of the rotation, [3, 3]."""
    @property
    def translation(self) -> NDArray[np.float64]:
        """[3], in scene units."""
    @property
    def center(self) -> NDArray[np.float64]:
        """Where it stands in the scene, [3]."""
    def resized(self, width: int, height: int) -> Camera:
        """The same camera for images of another size."""

class View:
    """A camera with the name of its photo, and its side of the split where that is known."""

    @property
    def name(self) -> str:
        """That of its photo in the scene."""
    @property
    def camera(self) -> Camera: ...
    @property
    def split(self) -> Split | None:
        """None where it is not known."""

class Scene:
    """Posed photos and points, loaded."""

    @staticmethod
    def load(path: Path, **options: Any) -> Scene:
        """Loads a folder of posed photos, or a ZIP archive of one.

        Options are those of the table `data` of the options file, with `_` in place of `-`: `eval=True` holds out every 8th photo,
        `resolution=2` halves the photos.
        """
    @staticmethod
    def demo(size: Literal["small", "large"] = "small", walkers: int = 0) -> Scene:
        """Ray traces the built-in scene: 40 photos of 160 x 120 pixels, or 120 of 640 x 480."""
    @property
    def views(self) -> list[View]:
        """All of them, those that are held out too."""
    def photo(self, name: str) -> NDArray[np.uint8]:
        """The pixels of a photo as it is trained on, RGBA, [height, width, 4]; alpha under 128 is masked."""
    @property
    def points(self) -> NDArray[np.float64]:
        """Positions of the points in scene units, [N, 3]."""
    @property
    def colors(self) -> NDArray[np.uint8]:
        """Colours of the points, [N, 3]."""

class Progress:
    """How far a training is. Loss and PSNR (dB, of the training photos) are means of recent iterations."""

    @property
    def iteration(self) -> int:
        """Number of those that are done."""
    @property
    def iterations(self) -> int:
        """Number of all."""
    @property
    def stage(self) -> str:
        """`base`, `surface` or `residual`."""
    @property
    def loss(self) -> float | None: ...
    @property
    def psnr(self) -> float | None: ...
    @property
    def gaussians(self) -> int:
        """Number of Gaussians."""
    @property
    def seconds(self) -> float:
        """Time spent in iterations."""

class Evaluation(TypedDict):
    """What was measured at an iteration: PSNR in dB of base and final image."""

    iteration: int
    gaussians: int
    base: float
    final: float | None

class Trainer:
    """A training of a scene.

    Options are those of the options file (docs/config.md), with `_` in place of `-`; tables are dictionaries:
    `Trainer(scene, iterations=7000, residual={"factor": 0.5})`. How the scene is loaded is said to `Scene`. Without `output` nothing is
    written. `on_event` is called with a sentence for everything that happens beside the iterations.
    """

    def __init__(
        self,
        scene: Scene,
        output: Path | None = None,
        *,
        preset: Literal["default", "best", "fast", "published"] = "default",
        overwrite: bool = False,
        gpu_memory: str = "auto",
        adapter: str | None = None,
        on_event: Callable[[str], Any] | None = None,
        **options: Any,
    ) -> None: ...
    @staticmethod
    def resume(path: Path, *, adapter: str | None = None, on_event: Callable[[str], Any] | None = None) -> Trainer:
        """Resumes a stopped training in its own folder, bit for bit as if it had not been stopped."""
    def run(self, each: Callable[[Progress], bool | None] | None = None) -> Progress:
        """Trains to the end, then saves and measures. `each` is called after every iteration; `False` ends the training."""
    def step(self, count: int = 1) -> Progress:
        """Some iterations, and what is due after each; nothing after the last one."""
    def finish(self) -> None:
        """Saves and measures the model as it is now, as `run` does at its end."""
    @property
    def progress(self) -> Progress:
        """How far it is."""
    @property
    def is_done(self) -> bool:
        """Whether all iterations are done."""
    @property
    def output(self) -> str | None:
        """The model folder."""
    @property
    def evaluations(self) -> list[Evaluation]:
        """What was measured on the held-out views so far: PSNR in dB."""
    def render(self, camera: Camera | View, outputs: Sequence[Output] = ["final"]) -> dict[str, NDArray[Any]]:
        """Images of the model as it is now; see `Model.render`."""

class Gaussians:
    """The parameters of N Gaussians, float32, as they are trained.

    Lengths are local: a point of the scene is `origin + unit * mean` with `origin, unit = space`. Arrays are copies; `replaced` makes
    Gaussians with other values.
    """

    @staticmethod
    def read(path: Path) -> Gaussians:
        """Reads a file of any format that docs/formats.md lists."""
    def write(self, path: Path) -> None:
        """Writes a file; its ending names the format."""
    def replaced(self, **fields: NDArray[np.float32]) -> Gaussians:
        """The same with other values: an array of the same shape for each field that changes."""
    def chosen(self, mask: NDArray[np.bool_]) -> Gaussians:
        """Those for which the mask, [N], is true."""
    @property
    def means(self) -> NDArray[np.float32]:
        """[N, 3]."""
    @property
    def rotations(self) -> NDArray[np.float32]:
        """Quaternions w, x, y, z, not normalised, [N, 4]."""
    @property
    def log_scales(self) -> NDArray[np.float32]:
        """Natural logarithms of the standard deviations, [N, 3]."""
    @property
    def opacity_logits(self) -> NDArray[np.float32]:
        """[N]."""
    @property
    def sh(self) -> NDArray[np.float32]:
        """Spherical harmonics, [N, (sh_degree + 1)^2, 3]; the first is the constant one."""
    @property
    def normals(self) -> NDArray[np.float32]:
        """Plane normals, not normalised, [N, 3]."""
    @property
    def offsets(self) -> NDArray[np.float32]:
        """Offsets of the planes along their normals, [N]."""
    @property
    def positions(self) -> NDArray[np.float64]:
        """The means in the scene's coordinates, [N, 3]."""
    @property
    def space(self) -> tuple[list[float], float]:
        """Origin and unit of the local coordinates."""
    @property
    def sh_degree(self) -> int:
        """0 to 3."""
    def __len__(self) -> int: ...

class Model:
    """A trained model on a GPU."""

    @staticmethod
    def open(
        path: Path,
        *,
        iteration: int | None = None,
        source: Path | None = None,
        precision: Literal["full", "auto"] = "full",
        adapter: str | None = None,
    ) -> Model:
        """Opens a model folder or a bundle. `source` is the scene's folder, if it has moved since the training.

        `precision` is that of `ibgs render`, whose default is `auto`: colours and the network's activations in half precision, and its arithmetic where that is faster.
        """
    @property
    def views(self) -> list[View]:
        """Those of the scene that it was trained on, held-out ones too."""
    @property
    def iteration(self) -> int:
        """The saved iteration that was opened."""
    @property
    def adapter(self) -> str:
        """The GPU that renders."""
    @property
    def options(self) -> dict[str, Any]:
        """What it was trained with, as `defaults` has it."""
    @property
    def gaussians(self) -> Gaussians:
        """Those of its first base; setting them changes what is rendered, and no file."""
    @gaussians.setter
    def gaussians(self, gaussians: Gaussians) -> None: ...
    def render(self, camera: Camera | View, outputs: Sequence[Output] = ["final"]) -> dict[str, NDArray[Any]]:
        """Renders a camera: an array for each output, by its name.

        `final`, `base`, `residual` and `normals` (camera space, not normalised) are float32, [height, width, 3], not clamped; `depth` is
        the median depth in scene units, float32, [height, width], 0 where nothing is met; `visibility` is the number of sources used,
        uint32, [height, width]. `final` of a model without a residual network is its base image.
        """
    def render_many(self, cameras: Sequence[Camera | View], outputs: Sequence[Output] = ["final"]) -> dict[str, NDArray[Any]]:
        """Renders cameras of one size: as `render`, with the arrays of all cameras stacked, [cameras, height, width, ...]."""
    def inspect(self, camera: Camera | View, x: int, y: int) -> dict[str, Any] | None:
        """What a pixel shows, and what each source photo says about it; none outside of the image."""
    def evaluate(self) -> dict[str, Any]:
        """PSNR in dB and SSIM of the held-out views, of `base` and `final`: `psnr`, `ssim`, and `views` by name."""

def defaults(preset: str = "default") -> dict[str, Any]:
    """The options of a preset, nested as the options file is. Options that follow others are left out."""

def psnr(image: NDArray[np.float32], photo: NDArray[np.uint8]) -> float:
    """PSNR in dB of an image, [height, width, 3], rounded to 8 bits, against a photo with or without alpha. Masked pixels do not
    count."""

def ssim(image: NDArray[np.float32], photo: NDArray[np.uint8]) -> float:
    """SSIM in Gaussian windows of 11 x 11 pixels; otherwise as `psnr`."""

def to_uint8(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Clamped to 0 to 1 and rounded to 8 bits, as pictures are written."""

def run(arguments: Sequence[str]) -> None:
    """Runs a command of the command line in this process: `ibgs.run(["export", "output/my-scene", "-o", "my-scene.ibgs"])`."""
