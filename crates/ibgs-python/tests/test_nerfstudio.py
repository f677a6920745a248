"""The method of nerfstudio, where that is installed."""

import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import ibgs

pytest.importorskip("nerfstudio")


def run(program, *arguments):
    command = [sys.executable, "-m", f"nerfstudio.scripts.{program}", *map(str, arguments)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout[-3000:]


def test_nerfstudio_trains_and_measures_as_ibgs_does(tmp_path):
    demo, scene, frames = ibgs.Scene.demo(), tmp_path / "scene", []
    (scene / "images").mkdir(parents=True)
    for view in demo.views:
        camera, pose = view.camera, np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.rotation.T @ np.diag([1, -1, -1]), camera.center
        Image.fromarray(demo.photo(view.name)[..., :3]).save(scene / "images" / view.name)
        lens = {"w": camera.width, "h": camera.height, "fl_x": camera.focal[0], "fl_y": camera.focal[1]}
        lens |= {"cx": camera.principal[0], "cy": camera.principal[1]}
        frames.append({"file_path": f"images/{view.name}", "transform_matrix": pose.tolist(), **lens})
    properties = [f"property float {axis}" for axis in "xyz"] + [f"property uchar {color}" for color in ["red", "green", "blue"]]
    header = ["ply", "format ascii 1.0", f"element vertex {len(demo.points)}", *properties, "end_header"]
    rows = [" ".join(map(str, [*point, *color])) for point, color in zip(demo.points, demo.colors)]
    (scene / "points.ply").write_text("\n".join([*header, *rows, ""]))
    described = {"camera_model": "PINHOLE", "ply_file_path": "points.ply", "frames": frames}
    (scene / "transforms.json").write_text(json.dumps(described))
    options = ["--vis", "tensorboard", "--machine.device-type", "cpu", "--output-dir", tmp_path, "--timestamp", "now"]
    run("train", "ibgs", "--data", scene, "--max-num-iterations", 14, *options)
    own = tmp_path / "scene/ibgs/now"
    run("eval", "--load-config", own / "config.yml", "--output-path", tmp_path / "scores.json")
    theirs = json.loads((tmp_path / "scores.json").read_text())["results"]
    scores = ibgs.Model.open(own / "ibgs").evaluate()["final"]
    # Their units and axes are other ones.
    assert theirs["psnr"] == pytest.approx(scores["psnr"], abs=0.01)
    assert theirs["ssim"] == pytest.approx(scores["ssim"], abs=1e-3)
