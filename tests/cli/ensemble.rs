//! A model of several bases.

use super::{Sandbox, files_in};
use ibgs_core::scene::read_gaussians;
use std::fs;

/// Folder and bundle of an ensemble give the pictures that its training gave.
#[test]
fn an_ensemble_is_rendered_from_folder_and_bundle() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.succeeds("train scene --iterations 30 --eval --ensemble 2 --exposure on -m model");
    let member = sandbox.path("model/point_cloud/iteration_30/member_2");
    assert!(member.join("point_cloud.ply").is_file() && member.join("exposure.json").is_file());
    let info = sandbox.succeeds("info model").stdout;
    assert!(info.contains("further bases"), "{info}");

    sandbox.succeeds("export model -o small.ibgs");
    sandbox.succeeds("render model --precision full -o folder");
    sandbox.succeeds("render small.ibgs --precision full -o bundle");
    for output in ["renders", "renders_aggregate"] {
        let names = files_in(&sandbox.path("model/test/ours_30").join(output));
        assert!(!names.is_empty());
        for name in names {
            let [trained, folder, bundle] = ["model", "folder", "bundle"].map(|root| {
                let path = sandbox.path(root).join("test/ours_30").join(output).join(&name);
                fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
            });
            assert!(folder == bundle, "{output} of {name:?}: folder and bundle differ");
            assert!(output != "renders" || trained == folder, "{name:?}: training and folder differ");
        }
    }
    sandbox.succeeds("export model -o chunks.ibgs --levels");
    let info = sandbox.succeeds("info chunks.ibgs").stdout;
    assert!(!info.contains("further bases"), "levels of detail are those of the first: {info}");
    sandbox.fails("train scene --iterations 30 --ensemble 9 -m other", &["ensemble", "between 1 and 8"]);

    // One model of both bases, with their exposures, for programs that show Gaussians alone.
    let count = |path: &str| read_gaussians(&sandbox.path(path)).unwrap().len();
    let both = count("model/point_cloud/iteration_30/point_cloud.ply")
        + count("model/point_cloud/iteration_30/member_2/point_cloud.ply");
    for (start, name) in [("model", "one"), ("small.ibgs", "again")] {
        sandbox.succeeds(&format!("train scene --method 3dgs --init {start} --iterations 2 -m {name}"));
        let folder = format!("{name}/point_cloud/iteration_2");
        assert_eq!(count(&format!("{folder}/point_cloud.ply")), both);
        assert!(sandbox.path(&folder).join("exposure.json").is_file(), "exposures stay");
        assert!(!sandbox.path(&folder).join("member_2").exists());
    }
    fs::remove_file(member.join("point_cloud.ply")).unwrap();
    sandbox.fails("render model", &["member_2", "point_cloud.ply"]);
}
