"""What several files of tests use."""

import json

import numpy as np
import pytest
from PIL import Image

import ibgs


@pytest.fixture(scope="session")
def scene_folder(tmp_path_factory):
    """The demo scene as a folder with `transforms.json`."""
    demo, folder, frames = ibgs.Scene.demo(), tmp_path_factory.mktemp("scenes") / "demo", []
    (folder / "images").mkdir(parents=True)
    for view in demo.views:
        camera, pose = view.camera, np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.rotation.T @ np.diag([1, -1, -1]), camera.center
        Image.fromarray(demo.photo(view.name)[..., :3]).save(folder / "images" / view.name)
        lens = {"w": camera.width, "h": camera.height, "fl_x": camera.focal[0], "fl_y": camera.focal[1]}
        lens |= {"cx": camera.principal[0], "cy": camera.principal[1]}
        frames.append({"file_path": f"images/{view.name}", "transform_matrix": pose.tolist(), **lens})
    properties = [f"property float {axis}" for axis in "xyz"] + [f"property uchar {color}" for color in ["red", "green", "blue"]]
    header = ["ply", "format ascii 1.0", f"element vertex {len(demo.points)}", *properties, "end_header"]
    rows = [" ".join(map(str, [*point, *color])) for point, color in zip(demo.points, demo.colors)]
    (folder / "points.ply").write_text("\n".join([*header, *rows, ""]))
    described = {"camera_model": "PINHOLE", "ply_file_path": "points.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(described))
    return folder
