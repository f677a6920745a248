//! Files of Gaussians of other programs, written, read and told about.

use super::Sandbox;
use ibgs_core::dataset::{LoadOptions, load_poses};
use ibgs_core::scene::{Format, read_gaussians};

/// The cameras of a model, written for other programs, are those of its scene.
#[test]
fn cameras_become_a_scene_again() {
    let (sandbox, _) = Sandbox::with_trained();
    let outcome = sandbox.succeeds("export model --cameras posed/sparse/0");
    assert!(outcome.stderr.contains("cameras of "), "{outcome}");
    std::os::unix::fs::symlink(sandbox.path("scene/images"), sandbox.path("posed/images")).unwrap();
    let [scene, posed] = ["scene", "posed"].map(|name| {
        let options = LoadOptions::default();
        load_poses(&sandbox.path(name), &options).unwrap().views
    });
    assert_eq!(scene.len(), posed.len());
    for ((name, camera), (other, again)) in scene.iter().zip(&posed) {
        assert_eq!((name, camera.focal, camera.principal), (other, again.focal, again.principal));
        assert!(camera.translation.abs_diff_eq(again.translation, 1e-12), "{name}");
        assert!(camera.view_from_world.abs_diff_eq(again.view_from_world, 1e-12), "{name}");
    }
    sandbox.fails("export model --cameras posed/sparse/0", &["posed/sparse/0", "--overwrite"]);
    sandbox.succeeds("export model --cameras posed/sparse/0 --overwrite");
    sandbox.run("export model --cameras other -o b.ply").assert_failure(2, &["--cameras", "--output"]);
}

#[test]
fn models_become_folders_with_levels_of_detail() {
    let (sandbox, _) = Sandbox::with_trained();
    let outcome = sandbox.succeeds("export model --streamed levels");
    assert!(outcome.stderr.contains("levels written, Gaussians of each level of detail: "), "{outcome}");
    sandbox.succeeds("export model -o a.ply");
    let read = |name: &str| read_gaussians(&sandbox.path(name)).unwrap().len();
    assert_eq!(read("levels/lod-meta.json"), read("a.ply"));
    sandbox.fails("export model --streamed levels", &["levels is not empty", "--overwrite"]);
    sandbox.succeeds("export model --streamed levels --overwrite");
    sandbox.run("export model --streamed other --plain").assert_failure(2, &["--streamed", "--plain"]);
}

#[test]
fn models_become_files_of_every_format() {
    let (sandbox, _) = Sandbox::with_trained();
    sandbox.succeeds("export model -o a.ply");
    let model = read_gaussians(&sandbox.path("a.ply")).unwrap();
    assert!(model.sh_degree > 0);
    for format in Format::written() {
        let name = format!("b{}", format.ending());
        let outcome = sandbox.succeeds(&format!("export model -o {name}"));
        assert!(outcome.stderr.contains(&format!("{name} written, ")), "{outcome}");
        let says = outcome.stderr.contains("spherical harmonics of degree 0") && outcome.stderr.contains(&name);
        assert_eq!(says, format.max_sh_degree() == 0, "{outcome}");
        let found = read_gaussians(&sandbox.path(&name)).unwrap();
        assert_eq!((found.len(), found.sh_degree), (model.len(), model.sh_degree.min(format.max_sh_degree())));
        let info = sandbox.succeeds(&format!("info {name}"));
        assert!(info.stdout.contains(&format!("{name}: {} Gaussians", model.len())), "{info}");
        // And back.
        let back = format!("back-{name}.ply");
        sandbox.succeeds(&format!("export {name} -o {back}"));
        assert_eq!(read_gaussians(&sandbox.path(&back)).unwrap(), found);
        sandbox.fails(&format!("export model -o {name}"), &[&name, "--overwrite"]);
    }
    // Contents count, not names.
    std::fs::rename(sandbox.path("b.spz"), sandbox.path("b.bin")).unwrap();
    sandbox.succeeds("info b.bin");
    sandbox.succeeds("export b.bin -o c.glb");
    sandbox.succeeds("train scene --init b.sog --iterations 1 -m warm");
    sandbox.fails("export b.glb -o c.ibgs", &["b.glb"]);
    sandbox.fails("export model -o c.spz --plain", &["--plain", "`.ply`"]);
    sandbox.succeeds("export model -o three.spz --spz 3");
    assert!(std::fs::read(sandbox.path("three.spz")).unwrap().starts_with(&[0x1f, 0x8b]));
    sandbox.fails("export model -o c.ply --spz 3", &["--spz", "`.spz`"]);
    sandbox.run("export model -o c.spz --spz 2").assert_failure(2, &["--spz", "neither 3 nor 4"]);
    sandbox.write("damaged.sog", b"PK\x03\x04 and so on");
    sandbox.fails("info damaged.sog", &["damaged.sog", "ZIP"]);
    sandbox.fails("train scene --init damaged.sog -m out", &["damaged.sog", "ZIP"]);
    sandbox.write("notes.txt", b"nothing");
    sandbox.fails("export notes.txt -o c.ply", &["notes.txt", "`.ply`, `.spz`"]);
}

#[test]
fn an_empty_file_is_called_empty() {
    let (sandbox, _) = Sandbox::with_trained();
    sandbox.succeeds("export model -o a.ply");
    let bytes = std::fs::read(sandbox.path("a.ply")).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let counted = header.lines().find(|line| line.starts_with("element vertex")).unwrap();
    sandbox.write("empty.ply", header.replace(counted, "element vertex 0"));
    let info = sandbox.succeeds("info empty.ply");
    assert_eq!(info.stdout.trim(), "empty.ply: no Gaussians; the file is empty");
    sandbox.fails("export empty.ply -o b.spz", &["b.spz", "no Gaussians"]);
}
