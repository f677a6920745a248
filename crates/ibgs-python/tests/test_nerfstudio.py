"""The method of nerfstudio, where that is installed."""

import json
import subprocess
import sys

import pytest

import ibgs

pytest.importorskip("nerfstudio")


def run(program, *arguments):
    command = [sys.executable, "-m", f"nerfstudio.scripts.{program}", *map(str, arguments)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout[-3000:]


def test_nerfstudio_trains_and_measures_as_ibgs_does(scene_folder, tmp_path):
    options = ["--vis", "tensorboard", "--machine.device-type", "cpu", "--output-dir", tmp_path, "--timestamp", "now"]
    run("train", "ibgs", "--data", scene_folder, "--max-num-iterations", 14, *options)
    own = tmp_path / scene_folder.name / "ibgs/now"
    run("eval", "--load-config", own / "config.yml", "--output-path", tmp_path / "scores.json")
    theirs = json.loads((tmp_path / "scores.json").read_text())["results"]
    scores = ibgs.Model.open(own / "ibgs").evaluate()["final"]
    # Their units and axes are other ones.
    assert theirs["psnr"] == pytest.approx(scores["psnr"], abs=0.01)
    assert theirs["ssim"] == pytest.approx(scores["ssim"], abs=1e-3)
