"""The package as its users meet it, on any adapter: `pytest` at the root of the repository."""

import pathlib

import numpy as np
import pytest
from PIL import Image

import ibgs

OPTIONS = {"iterations": 14, "densify": {"max_splats": 3000}, "residual": {"factor": 0.25}, "ensemble": 1}


@pytest.fixture(scope="session")
def scene():
    return ibgs.Scene.demo()


@pytest.fixture(scope="session")
def folder(scene, tmp_path_factory):
    """A short training, with what it said."""
    folder = tmp_path_factory.mktemp("models") / "demo"
    said, seen = [], []
    trainer = ibgs.Trainer(scene, folder, on_event=said.append, **OPTIONS)
    end = trainer.run(lambda progress: seen.append(progress.iteration))
    assert seen == list(range(1, 15)) and end.iteration == 14 and trainer.is_done
    assert any("trained 14 iterations" in text for text in said), said
    assert trainer.evaluations[-1]["final"] > 10
    return folder


def test_a_scene_is_arrays(scene):
    view = scene.views[0]
    photo = scene.photo(view.name)
    assert photo.shape == (view.camera.height, view.camera.width, 4) and photo.dtype == np.uint8
    assert scene.points.shape == (len(scene.colors), 3)
    rotation = view.camera.rotation
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.allclose(view.camera.center, -rotation.T @ view.camera.translation)
    assert {view.split for view in scene.views} == {"train", "test"}


def test_a_camera_is_what_was_given():
    camera = ibgs.Camera(64, 48, (50.0, 51.0), np.eye(3), np.array([0.0, 0.5, 2.0]))
    assert (camera.width, camera.height, camera.focal, camera.principal) == (64, 48, (50.0, 51.0), (32.0, 24.0))
    assert camera.resized(32, 24).focal == (25.0, 25.5)
    with pytest.raises(ibgs.Error, match="no rotation"):
        ibgs.Camera(64, 48, (50.0, 51.0), 2 * np.eye(3), np.zeros(3))


def test_a_model_renders_as_the_command_line_does(folder, tmp_path):
    model = ibgs.Model.open(folder)
    held_out = [view for view in model.views if view.split == "test"]
    outputs = ["final", "base", "residual", "depth", "normals", "visibility"]
    images = model.render(held_out[0], outputs)
    size = (held_out[0].camera.height, held_out[0].camera.width)
    for name in ["final", "base", "residual", "normals"]:
        assert images[name].shape == (*size, 3) and images[name].dtype == np.float32
    assert images["depth"].shape == size and images["visibility"].dtype == np.uint32
    assert np.allclose(images["final"] - images["base"], images["residual"])
    scores = model.evaluate()
    photo = ibgs.Scene.demo().photo(held_out[0].name)
    own = scores["final"]["views"][held_out[0].name]
    assert own["psnr"] == pytest.approx(ibgs.psnr(images["final"], photo), abs=0.01)
    assert own["ssim"] == pytest.approx(ibgs.ssim(images["final"], photo), abs=1e-3)
    pixel = model.inspect(held_out[0], 80, 60)
    assert np.allclose(pixel["base"], images["base"][60, 80])
    assert model.inspect(held_out[0], 10_000, 0) is None


def test_many_cameras_are_rendered_in_one_call(folder):
    model = ibgs.Model.open(folder)
    views = model.views[:3]
    outputs = ["final", "depth", "visibility"]
    many = model.render_many(views, outputs)
    for output in outputs:
        each = np.stack([model.render(view, [output])[output] for view in views])
        assert many[output].dtype == each.dtype and np.array_equal(many[output], each), output
    other = ibgs.Camera(32, 24, focal=(30.0, 30.0), rotation=np.eye(3), translation=[0.0, 0.0, 4.0])
    with pytest.raises(ibgs.Error, match="cameras of one size .* 32 x 24"):
        model.render_many([views[0], other])
    with pytest.raises(ibgs.Error, match="no cameras"):
        model.render_many([])


@pytest.mark.parametrize("precision", ["full", "auto"])
def test_pictures_are_those_of_the_command_line(folder, tmp_path, precision):
    ibgs.run(["render", str(folder), "--outputs", "final,base", "--precision", precision, "-o", str(tmp_path)])
    model = ibgs.Model.open(folder, precision=precision)
    for view in [view for view in model.views if view.split == "test"]:
        images = model.render(view, ["final", "base"])
        for name, place in [("final", "renders_aggregate"), ("base", "renders")]:
            written = np.asarray(Image.open(tmp_path / "test/ours_14" / place / view.name))
            assert np.array_equal(ibgs.to_uint8(images[name]), written), (view.name, name)
    with pytest.raises(ibgs.Error, match="precision: .*half"):
        ibgs.Model.open(folder, precision="half")


def test_gaussians_are_read_changed_and_written(folder, tmp_path):
    model = ibgs.Model.open(folder)
    own = model.gaussians
    assert own.means.shape == (len(own), 3) and own.sh.shape == (len(own), (own.sh_degree + 1) ** 2, 3)
    origin, unit = own.space
    assert np.allclose(own.positions, np.array(origin) + unit * own.means, atol=1e-4)
    view = model.views[0]
    before = model.render(view, ["base"])["base"]
    model.gaussians = own.replaced(opacity_logits=np.full(len(own), -20.0, np.float32))
    assert np.abs(model.render(view, ["base"])["base"]).max() < 1e-3, "nothing is left to see"
    model.gaussians = own
    assert np.array_equal(model.render(view, ["base"])["base"], before)
    half = own.chosen(np.arange(len(own)) % 2 == 0)
    half.write(tmp_path / "half.ply")
    assert np.array_equal(ibgs.Gaussians.read(tmp_path / "half.ply").opacity_logits, half.opacity_logits)
    with pytest.raises(ibgs.Error, match="`means` has the shape"):
        own.replaced(means=np.zeros((1, 3), np.float32))
    with pytest.raises(ibgs.Error, match="no field `colour`"):
        own.replaced(colour=np.zeros(1, np.float32))


def test_a_training_is_stopped_and_resumed(scene, tmp_path):
    folder = tmp_path / "stopped"
    trainer = ibgs.Trainer(scene, folder, **{**OPTIONS, "iterations": 6})
    trainer.run(lambda progress: progress.iteration < 3)
    assert trainer.progress.iteration == 3 and not trainer.is_done
    shown = trainer.render(scene.views[0], ["base"])["base"]
    assert np.isfinite(shown).all()
    del trainer
    resumed = ibgs.Trainer.resume(folder)
    assert resumed.progress.iteration == 3
    assert resumed.run().iteration == 6


def test_what_a_function_raises_comes_back(scene):
    def broken(progress):
        raise ValueError("of mine")

    trainer = ibgs.Trainer(scene, **{**OPTIONS, "iterations": 3})
    with pytest.raises(ValueError, match="of mine"):
        trainer.run(broken)


def test_errors_are_the_sentences_of_the_command_line(scene, tmp_path):
    with pytest.raises(ibgs.Error, match="nowhere"):
        ibgs.Scene.load(tmp_path / "nowhere")
    with pytest.raises(ibgs.Error, match="no-model"):
        ibgs.Model.open(tmp_path / "no-model")
    for options, word in [
        ({"iteration": 3}, "iteration"),
        ({"densify": {"intervall": 3}}, "intervall"),
        ({"ssim_weight": 2.0}, "ssim-weight"),
        ({"preset": "slow"}, "slow"),
    ]:
        with pytest.raises(ibgs.Error, match=word):
            ibgs.Trainer(scene, **options)
    assert ibgs.defaults()["densify"]["split_divisor"] == 1.6
    assert ibgs.defaults("fast")["residual"]["factor"] == 0.5


def test_the_command_line_runs_in_the_process(folder, tmp_path, capfd):
    bundle = tmp_path / "demo.ibgs"
    ibgs.run(["export", str(folder), "-o", str(bundle)])
    assert bundle.stat().st_size > 0
    view = ibgs.Model.open(bundle).views[0]
    images = [ibgs.to_uint8(ibgs.Model.open(path).render(view)["final"]) for path in [folder, bundle]]
    assert np.abs(images[0].astype(int) - images[1].astype(int)).mean() < 2
    with pytest.raises(ibgs.Error, match="nowhere"):
        ibgs.run(["info", str(tmp_path / "nowhere")])
    with pytest.raises(SystemExit) as stopped:
        ibgs.run(["train", "--no-such-option"])
    assert stopped.value.code == 2


def test_the_version_is_that_of_the_program():
    root = pathlib.Path(__file__).parents[3]
    assert f'version = "{ibgs.__version__}"' in (root / "Cargo.toml").read_text()
