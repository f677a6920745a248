//! The editor on a model of several bases.

use super::edit::{canvas, command, counts, differs, editing, open, pick, write_bundle};
use super::*;
use glam::DVec3;
use ibgs_core::edit::Mask;
use ibgs_core::ensemble::Member;
use ibgs_core::exposure::Exposure;
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::scene::{Gaussians, read_gaussians};

/// An ensemble whose second base has a degree and exposures of its own; the third lies in the middle of the scene.
fn ensemble(path: &Path) {
    let dataset = many_points();
    let mut points = dataset.points.clone();
    let mut second = from_points(&points[..1_500], 2, 0.4).unwrap();
    second.sh.iter_mut().zip(0..).for_each(|(value, i)| *value += 0.01 * (i % 7) as f32);
    let middle = points.iter().map(|point| point.position).sum::<DVec3>() / points.len() as f64;
    points.sort_by(|a, b| a.position.distance(middle).total_cmp(&b.position.distance(middle)));
    let third = from_points(&points[..200], 1, 0.9).unwrap();
    let exposure = Exposure { log_gain: [0.3, 0.0, -0.3], offset: [0.05; 3] };
    let exposures = dataset.train.iter().map(|&index| (dataset.views[index].name.clone(), exposure)).collect();
    let members = [(second, Some(exposures)), (third, None)].map(|(gaussians, exposure)| Member {
        gaussians,
        network: None,
        exposure,
    });
    write_bundle(path, from_points(&dataset.points, 0, 0.6).unwrap(), members.into());
}

/// The Gaussians of every base, in the coordinates in which the model is rendered.
fn bases(model: &Model) -> Vec<Gaussians> {
    let members = model.members.iter().map(|member| &member.gaussians);
    let all = std::iter::once(&model.gaussians).chain(members);
    all.map(|base| base.in_space(model.space()).into_owned()).collect()
}

#[test]
fn every_base_of_an_ensemble_is_edited() {
    let folder = tempfile::tempdir().unwrap();
    let (path, saved) = (folder.path().join("model.ibgs"), folder.path().join("model-edited.ibgs"));
    ensemble(&path);
    let mut window = editing(open(&path));
    assert_eq!(counts(&window), [5_700, 0]);
    let before = canvas(&mut window);
    pick(&mut window, "Box");
    pick(&mut window, "Inside");
    let mut whole = Model::open(&path, &ModelOptions::default()).unwrap();
    let crop = *window.state().crop_box().unwrap();
    let beside = |base: &Gaussians| Mask::all(base.len()).without(&crop.found(base)).of_model(base);
    let left: Vec<_> = bases(&whole).iter().map(beside).collect();
    let numbers: Vec<_> = left.iter().map(Gaussians::len).collect();
    assert!((1..4_000).contains(&numbers[0]) && (1..1_500).contains(&numbers[1]) && numbers[2] == 0, "{numbers:?}");
    press(&mut window, Key::Delete);
    assert_eq!(counts(&window), [numbers.iter().sum(), 0]);
    press(&mut window, Key::Escape);
    press(&mut window, Key::P);
    pick(&mut window, "Save model");
    assert!(window.state().message().unwrap().contains("model-edited.ibgs"), "{:?}", window.state().error());
    // The saved model has what lies beside the box, with every value that it had, and shows what the window did.
    let mut model = Model::open(&saved, &ModelOptions::default()).unwrap();
    assert_eq!(bases(&model).iter().map(Gaussians::len).collect::<Vec<_>>(), numbers);
    for (base, expected) in bases(&model).iter().zip(&left) {
        let values = |base: &Gaussians| (base.sh_degree, base.sh.clone(), base.opacity_logits.clone());
        assert!(values(base) == values(expected));
        assert!(base.positions().zip(expected.positions()).all(|(a, b)| a.distance(b) < 1e-4));
    }
    assert_eq!(model.members[0].exposure, whole.members[0].exposure);
    let edited = differs(folder.path(), &model.renderer(&gpu()).unwrap(), &model);
    let first_alone = whole.renderer(&gpu()).unwrap().with_splats(Splats::upload(&left[0], &gpu()).unwrap());
    let first_alone = differs(folder.path(), &first_alone, &whole);
    assert!(edited < 0.001 && first_alone > 0.1, "{edited} and {first_alone} of the values differ");
    // A file of Gaussians has no room for further bases.
    let cloud = folder.path().join("first.ply");
    window.state_mut().set_model_file(&cloud);
    pick(&mut window, "Save model");
    let message = window.state().message().unwrap().to_owned();
    assert!(message.contains(&format!("{} Gaussians, those of the first base alone", numbers[0])), "{message}");
    assert_eq!(read_gaussians(&cloud).unwrap().len(), numbers[0]);
    for _ in 0..2 {
        command(&mut window, Modifiers::COMMAND, Key::Z);
    }
    assert_eq!(counts(&window), [5_700, 0]);
    assert!(canvas(&mut window) == before, "undone, the picture is what it was");
    assert_eq!(window.state().error(), None);
}
