"""The examples of docs/python.md, one after the other, with short trainings."""

import pathlib
import re

import ibgs

TEXT = (pathlib.Path(__file__).parents[3] / "docs/python.md").read_text()
SHORT = {"iterations": 24, "densify": {"max_splats": 3000}, "residual": {"factor": 0.25}, "ensemble": 1}


def test_the_examples_run(scene_folder, tmp_path, monkeypatch):
    examples = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert len(examples) == 10
    (tmp_path / "my-scene").symlink_to(scene_folder)
    monkeypatch.chdir(tmp_path)
    made = []

    class Trainer:
        """Short ones."""

        resume = staticmethod(ibgs.Trainer.resume)

        def __new__(cls, scene, output, trainer=ibgs.Trainer, **options):
            made.append(options)
            return trainer(scene, output, **{**options, **SHORT})

    monkeypatch.setattr(ibgs, "Trainer", Trainer)
    names = {}
    for example in examples:
        # So short a training does not get that far.
        exec(compile(example.replace("now.psnr is None or now.psnr < 35", "now.iteration < 12"), example, "exec"), names)
    assert [sorted(options) for options in made] == [["on_event"], ["iterations", "preset", "residual"]]
    assert names["trainer"].is_done
    assert names["images"]["depth"].shape == (120, 160)
    assert names["image"].shape == (120, 160, 3)
    assert 0 < len(names["solid"]) < len(names["own"])
    for written in ["view.png", "solid.ply", "my-scene.ibgs", "output/small/point_cloud/iteration_24"]:
        assert (tmp_path / written).exists(), written
