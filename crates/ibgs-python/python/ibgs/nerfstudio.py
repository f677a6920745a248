"""A method of nerfstudio: `ns-train ibgs --data FOLDER`, and `ns-viewer`, `ns-eval` and `ns-render` of what it trained.

ibgs trains; nerfstudio has the loop and the viewer, and asks for images. It finds this module by the package's entry point; nothing else
imports it.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, List, Literal, Optional, Tuple, Type, Union

import numpy as np
import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.configs.base_config import ViewerConfig
from nerfstudio.data.datamanagers.full_images_datamanager import FullImageDatamanager, FullImageDatamanagerConfig
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
from nerfstudio.engine.callbacks import TrainingCallback, TrainingCallbackAttributes, TrainingCallbackLocation
from nerfstudio.engine.optimizers import AdamOptimizerConfig
from nerfstudio.engine.trainer import TrainerConfig
from nerfstudio.models.base_model import Model, ModelConfig
from nerfstudio.pipelines.base_pipeline import VanillaPipeline, VanillaPipelineConfig
from nerfstudio.plugins.types import MethodSpecification

import ibgs

# From the axes of nerfstudio's cameras (x right, y up, z back) to those of ibgs, and back.
AXES = np.diag([1.0, -1.0, -1.0])


class Alignment:
    """From scene units to nerfstudio's, which its data parsers turn, move and scale: `scale * turn @ point + shift`."""

    def __init__(self, views: List[ibgs.View], data: FullImageDatamanager) -> None:
        own = {Path(view.name).name: view.camera for view in views}
        dataset = data.train_dataset
        poses = dataset.cameras.camera_to_worlds.cpu().numpy().astype(np.float64)
        pairs = [(own[path.name], pose) for path, pose in zip(dataset.image_filenames, poses) if path.name in own]
        if len(pairs) < 2:
            raise ibgs.Error(f"{data.get_datapath()}: ibgs and nerfstudio find no two photos of the same name")
        centers, theirs = np.array([camera.center for camera, _ in pairs]), np.array([pose[:, 3] for _, pose in pairs])
        camera, pose = pairs[0]
        self.turn = pose[:, :3] @ AXES @ camera.rotation
        spread = np.linalg.norm(theirs - theirs.mean(0))
        self.scale = spread / np.linalg.norm(centers - centers.mean(0))
        self.shift = theirs.mean(0) - self.scale * self.turn @ centers.mean(0)
        error = np.linalg.norm(self.scale * centers @ self.turn.T + self.shift - theirs)
        if not error < 1e-3 * spread:
            raise ibgs.Error(f"{data.get_datapath()}: the poses of ibgs and of nerfstudio differ")

    def camera(self, camera: Cameras) -> ibgs.Camera:
        """A camera of nerfstudio in scene units."""
        pose = camera.camera_to_worlds.reshape(3, 4).cpu().numpy().astype(np.float64)
        rotation = AXES @ pose[:, :3].T @ self.turn
        center = self.turn.T @ (pose[:, 3] - self.shift) / self.scale
        number = lambda values: values.reshape(-1)[0].item()
        focal, principal = (number(camera.fx), number(camera.fy)), (number(camera.cx), number(camera.cy))
        return ibgs.Camera(int(number(camera.width)), int(number(camera.height)), focal, rotation, -rotation @ center, principal)


@dataclass
class IbgsModelConfig(ModelConfig):
    """It has no options of its own."""

    _target: Type = field(default_factory=lambda: IbgsModel)
    enable_collider: bool = False


class IbgsModel(Model):
    """Images of an ibgs model, or of one in training."""

    shown: Optional[Union[ibgs.Model, ibgs.Trainer]] = None
    alignment: Optional[Alignment] = None

    def populate_modules(self) -> None:
        super().populate_modules()
        # The loop's optimizer wants a parameter.
        self.anchor = torch.nn.Parameter(torch.zeros(1))

    def get_param_groups(self) -> Dict[str, List[torch.nn.Parameter]]:
        return {"anchor": [self.anchor]}

    def get_outputs(self, ray_bundle: Cameras) -> Dict[str, torch.Tensor]:
        images = self.shown.render(self.alignment.camera(ray_bundle), ["final", "base", "residual", "depth"])
        named = {
            "rgb": images["final"].clip(0, 1),
            "base": images["base"].clip(0, 1),
            # Grey where it changes nothing.
            "residual": (0.5 + images["residual"]).clip(0, 1),
            "depth": images["depth"][..., None] * np.float32(self.alignment.scale),
            # Where there is a depth.
            "accumulation": (images["depth"][..., None] > 0).astype(np.float32),
        }
        return {name: torch.from_numpy(np.ascontiguousarray(image)).to(self.device) for name, image in named.items()}

    @torch.no_grad()
    def get_outputs_for_camera(self, camera: Cameras, obb_box: Any = None) -> Dict[str, torch.Tensor]:
        return self.get_outputs(camera)

    def get_image_metrics_and_images(
        self, outputs: Dict[str, torch.Tensor], batch: Dict[str, Any]
    ) -> Tuple[Dict[str, float], Dict[str, torch.Tensor]]:
        image, photo = outputs["rgb"].cpu(), batch["image"].cpu()
        photo = photo if photo.dtype == torch.uint8 else (255 * photo).round().to(torch.uint8)
        measured = image.numpy(), np.ascontiguousarray(photo.numpy())
        both = torch.cat([photo[..., :3] / 255, image], dim=1)
        return {"psnr": ibgs.psnr(*measured), "ssim": ibgs.ssim(*measured)}, {"img": both}


@dataclass
class IbgsPipelineConfig(VanillaPipelineConfig):
    """What is trained."""

    _target: Type = field(default_factory=lambda: IbgsPipeline)
    preset: Literal["default", "best", "fast", "published"] = "default"
    """Preset of ibgs."""


class IbgsPipeline(VanillaPipeline):
    """Hands the iterations of nerfstudio's loop to a training of ibgs, which writes its own model folder beside the checkpoints."""

    def get_training_callbacks(self, training_callback_attributes: TrainingCallbackAttributes) -> List[TrainingCallback]:
        loop = training_callback_attributes.trainer
        if self.model.shown is not None:
            raise ibgs.Error(f"{loop.config.load_dir}: ns-train does not resume; `ibgs train --resume` does, in the folder `ibgs`")
        data = self.datamanager
        scene = ibgs.Scene.load(data.get_datapath(), eval=True)
        trained = {Path(view.name).name for view in scene.views if view.split == "train"}
        if trained != {path.name for path in data.train_dataset.image_filenames}:
            raise ibgs.Error(
                f"{data.get_datapath()}: nerfstudio holds out other photos than every 8th; "
                "choose `--eval-mode interval --eval-interval 8` for its data parser"
            )
        length = loop.config.max_num_iterations
        options = {"iterations": length} if length > 0 else {}
        trainer = ibgs.Trainer(scene, loop.base_dir / "ibgs", preset=self.config.preset, on_event=print, **options)
        loop.config.max_num_iterations = trainer.progress.iterations
        self.model.shown, self.model.alignment = trainer, Alignment(scene.views, data)
        finish = TrainingCallback([TrainingCallbackLocation.AFTER_TRAIN], lambda step: trainer.finish())
        return super().get_training_callbacks(training_callback_attributes) + [finish]

    def get_train_loss_dict(self, step: int) -> Tuple[Dict, Dict[str, torch.Tensor], Dict[str, float]]:
        now = self.model.shown.step()
        loss = 0 * self.model.anchor.sum() + (now.loss or 0.0)
        return {}, {"loss": loss}, {"psnr": now.psnr or 0.0, "gaussians": now.gaussians}

    def get_extra_state(self) -> Dict[str, str]:
        return {"folder": str(Path(self.model.shown.output).resolve())}

    def set_extra_state(self, state: Dict[str, str]) -> None:
        model = ibgs.Model.open(state["folder"])
        self.model.shown, self.model.alignment = model, Alignment(model.views, self.datamanager)


METHOD = MethodSpecification(
    config=TrainerConfig(
        method_name="ibgs",
        # 0: as many as ibgs has for the scene.
        max_num_iterations=0,
        steps_per_save=0,
        steps_per_eval_batch=0,
        steps_per_eval_image=0,
        steps_per_eval_all_images=0,
        pipeline=IbgsPipelineConfig(
            datamanager=FullImageDatamanagerConfig(dataparser=NerfstudioDataParserConfig(eval_mode="interval", load_3D_points=False)),
            model=IbgsModelConfig(),
        ),
        optimizers={"anchor": {"optimizer": AdamOptimizerConfig(), "scheduler": None}},
        viewer=ViewerConfig(),
        vis="viewer",
    ),
    description="Image-Based Gaussian Splatting, trained and rendered by ibgs.",
)
