//! From a model to a mesh and its scores.

use super::Sandbox;
use std::fs;

/// Number of vertices and triangles that the header of a PLY file tells.
fn ply_counts(sandbox: &Sandbox, name: &str) -> [usize; 2] {
    let bytes = fs::read(sandbox.path(name)).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    ["element vertex ", "element face "].map(|start| {
        let line = text.lines().find_map(|line| line.strip_prefix(start)).unwrap();
        line.parse().unwrap()
    })
}

#[test]
fn a_model_becomes_a_mesh_that_is_measured() {
    let (sandbox, _) = Sandbox::with_trained();
    let told = sandbox.succeeds("mesh model").stderr;
    let [vertices, triangles] = ply_counts(&sandbox, "model/mesh/ours_30/mesh.ply");
    assert!(vertices > 100 && triangles > 100, "{vertices} vertices, {triangles} triangles");
    assert!(
        told.contains("voxels of ") && told.contains(&format!("{triangles} triangles, {vertices} vertices")),
        "{told}"
    );
    assert!(!sandbox.path("model/results_mesh.json").exists());
    assert!(fs::metadata(sandbox.path("model/mesh/ours_30/mesh.ply")).unwrap().len() > 27 * vertices as u64);

    // The same mesh in each format.
    let options = "--voxel-size 0.1 --clusters 0 --width 40";
    for name in ["out/a.ply", "out/a.obj", "out/a.glb"] {
        sandbox.succeeds(&format!("mesh model {options} -o {name}"));
    }
    let [vertices, triangles] = ply_counts(&sandbox, "out/a.ply");
    let lines = |start: &str| sandbox.text("out/a.obj").lines().filter(|line| line.starts_with(start)).count();
    assert_eq!((lines("v "), lines("vn "), lines("f ")), (vertices, vertices, triangles));
    assert!(fs::read(sandbox.path("out/a.glb")).unwrap().starts_with(b"glTF"));
    sandbox.succeeds(&format!("mesh model {options} --bounds -1,-1,0,1,1,1 -o part.ply"));
    assert!(ply_counts(&sandbox, "part.ply")[1] < triangles);
    fewer_triangles(&sandbox, options, triangles);
    texture(&sandbox, options);
    compare(&sandbox, options);
    wrong_use(&sandbox);
}

fn fewer_triangles(sandbox: &Sandbox, options: &str, triangles: usize) {
    let told = sandbox.succeeds(&format!("mesh model {options} --triangles 300 -o few.ply")).stderr;
    let few = ply_counts(sandbox, "few.ply")[1];
    assert!((200..=300).contains(&few) && told.contains(&format!("from {triangles} to {few} triangles")), "{told}");
    sandbox.succeeds(&format!("mesh model {options} --max-error 0.01 -o near.ply"));
    assert!((few..triangles).contains(&ply_counts(sandbox, "near.ply")[1]));
    let told = sandbox.succeeds(&format!("mesh model {options} --fill-holes 60 -o closed.ply")).stderr;
    assert!(
        told.contains("holes of up to 60 edges closed") && ply_counts(sandbox, "closed.ply")[1] > triangles,
        "{told}"
    );
}

fn texture(sandbox: &Sandbox, options: &str) {
    let told = sandbox.succeeds(&format!("mesh model {options} --texture -o t/a.obj")).stderr;
    assert!(
        sandbox.text("t/a.mtl").ends_with("\nmap_Kd a.png\n") && sandbox.text("t/a.obj").starts_with("mtllib a.mtl\n")
    );
    let image = image::open(sandbox.path("t/a.png")).unwrap().to_rgb8();
    let colors: std::collections::HashSet<_> = image.pixels().collect();
    let side = image.width();
    assert!(told.contains(&format!("texture of {side} x {side}")) && told.contains("% of it from photos"), "{told}");
    assert!(image.height() == side && colors.len() > 500, "{side} x {}, {} colours", image.height(), colors.len());
    sandbox.succeeds(&format!("mesh model {options} --texture"));
    let bytes = fs::read(sandbox.path("model/mesh/ours_30/mesh.glb")).unwrap();
    assert!(bytes.windows(10).any(|word| word == b"TEXCOORD_0") && bytes.windows(4).any(|word| word == b"IHDR"));

    sandbox.write("t/b.png", "a picture");
    sandbox.fails("mesh model --texture -o t/b.obj", &["b.png is there already", "choose another name"]);
    assert_eq!(sandbox.text("t/b.png"), "a picture");
    sandbox.fails("mesh model --texture -o t/b.ply", &["b.ply cannot have a texture", "`.glb` or `.obj`"]);
    sandbox.fails("mesh model --texture --memory 1KiB", &["the depth maps and photos of 8 views", "`--width`"]);
    let tiny = format!("mesh model {options} --texture --texture-size 64 -o t/c.glb");
    sandbox.fails(&tiny, &["the side of the texture is 64, which is not large enough"]);
    assert!(!sandbox.path("t/c.glb").exists());
}

fn compare(sandbox: &Sandbox, options: &str) {
    let told =
        sandbox.succeeds(&format!("mesh model {options} --compare demo --threshold 0.2,0.4 -o out/a.ply")).stdout;
    assert!(told.contains("within 0.2: precision ") && told.contains(" degrees in the mean"), "{told}");
    let results = &sandbox.json("model/results_mesh.json")["ours_30"];
    let number =
        |path: &str| results.pointer(path).and_then(|v| v.as_f64()).unwrap_or_else(|| panic!("{path}: {results}"));
    for name in ["precision", "recall", "f1"] {
        let [fine, coarse] = [0, 1].map(|i| number(&format!("/f_scores/{i}/{name}")));
        assert!(0.0 < fine && fine < coarse && coarse <= 1.0, "{name}: {results}");
    }
    let [accuracy, completeness] = ["accuracy", "completeness"].map(|name| number(&format!("/chamfer/{name}")));
    assert!(
        (number("/chamfer/chamfer") - (accuracy + completeness) / 2.0).abs() < 1e-12 && accuracy > 0.0,
        "{results}"
    );
    assert!(
        (0.0..90.0).contains(&number("/normal_map/mean_degrees")) && number("/normal_map/views") == 2.0,
        "{results}"
    );
    assert!((0.0..90.0).contains(&number("/f_scores/0/normal_error_degrees")), "{results}");
    assert_eq!((number("/mesh/voxel_size"), number("/chamfer/density")), (0.1, 0.1));

    // The mesh itself as the truth, moved there and back, in the half that a volume holds.
    let own = |more: &str| {
        sandbox.succeeds(&format!("mesh model {options} --threshold 0.05 --compare out/a.ply {more} -o b.ply"))
    };
    let told = own("").stdout;
    assert!(told.contains("F1 1.0000, normals off by 0.00"), "{told}");
    assert_eq!(sandbox.json("model/results_mesh.json")["ours_30"]["compared_with"], "out/a.ply");
    sandbox.write("shift.txt", "1 0 0 0.3\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    let score = |told: &str| told.split("F1 ").nth(1).unwrap()[..6].parse::<f64>().unwrap();
    assert!(score(&own("--transform shift.txt").stdout) < 0.9);
    sandbox.write("half.json", volume(0.0));
    assert!(own("--crop half.json").stdout.contains("F1 1.0000"));
}

fn volume(from: f64) -> String {
    format!(
        r#"{{"orthogonal_axis": "Z", "axis_min": {from}, "axis_max": 100.0,
        "bounding_polygon": [[0, -9, 0], [9, -9, 0], [9, 9, 0], [0, 9, 0]]}}"#
    )
}

fn wrong_use(sandbox: &Sandbox) {
    sandbox.fails("mesh nowhere", &["nowhere", "check the path"]);
    sandbox.fails("mesh model -o a.stl", &["a.stl", "must end in `.ply`, `.obj` or `.glb`"]);
    sandbox.fails("mesh model --voxel-size 0", &["the voxel size is 0"]);
    sandbox.fails("mesh model --truncation 100", &["the truncation is 100", "from 1 to 32"]);
    sandbox.fails("mesh model --bounds 1,2,3", &["`--bounds` has 3 numbers"]);
    sandbox.fails("mesh model --bounds 0,0,0,1,0,1", &["bounds", "larger than 0"]);
    sandbox.fails("mesh model --max-angle 91", &["`--max-angle` is 91"]);
    sandbox.fails("mesh model --triangles 3", &["the number of triangles is 3, which is not 4 or more"]);
    sandbox.fails("mesh model --max-error 0", &["the largest error is 0, which is not a positive number"]);
    sandbox.fails("mesh model --fill-holes 1001", &["`--fill-holes` is 1001; choose at most 1000"]);
    sandbox.fails("mesh model --memory 1KiB", &["8 views", "`--width`", "`--memory`"]);
    sandbox.fails("mesh model --voxel-size 0.001 --memory 1MiB", &["voxels of 0.0010", "choose a voxel size of"]);
    sandbox.fails("mesh model --bounds 50,50,50,60,60,60", &["no surface within the bounds"]);
    sandbox.fails("mesh model --threshold 0.1", &["`--threshold` needs `--compare`"]);
    sandbox.fails("mesh model --compare out/a.ply", &["a.ply", "needs a `--threshold`"]);
    sandbox.fails("mesh model --compare out/a.ply --threshold 0", &["`--threshold` is 0"]);
    sandbox.fails("mesh model --compare demo --crop half.json", &["neither `--transform` nor `--crop`"]);
    sandbox.fails("mesh model --compare nowhere.ply --threshold 1", &["cannot read nowhere.ply"]);
    sandbox.fails("mesh model --compare scene/transforms.json --threshold 1", &["transforms.json", "is no PLY file"]);
    sandbox.fails(
        "mesh model --compare out/a.ply --threshold 1 --transform half.json",
        &["half.json", "is no 4 x 4 matrix"],
    );
    sandbox.fails("mesh model --compare out/a.ply --threshold 1 --crop shift.txt", &["shift.txt", "is no crop volume"]);
    sandbox.write("far.json", volume(50.0));
    let far = "mesh model --compare out/a.ply --threshold 1 --crop far.json -o out/a.ply --voxel-size 0.1 --clusters 0 --width 40";
    sandbox.fails(far, &["the mesh has no point within the crop volume"]);
}
