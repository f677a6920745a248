//! A checkpoint, made without a training.

use serde_json::{Value, json};

/// A whole checkpoint of plain splatting with two Gaussians after three iterations, part by part, with these options.
pub fn parts(format: u32, version: &str, config: &str) -> Vec<(String, Vec<u8>)> {
    let header = json!({ "format": format, "version": version, "scene": 7 });
    let rng = json!({ "seed": vec![0; 32], "stream": 0, "word_pos": 5 });
    let telemetry = json!({ "stats": { "loss": 0.5, "l1": 0.1, "ssim": 0.9, "mse": 0.01 }, "most_isects": 9, "broken": false,
        "overflows": 0 });
    let recorder = json!({ "written": 3, "capacities": vec![100; 32], "ring": vec![0; 256], "pending": null });
    let state = json!({ "iteration": 3, "space": { "origin": [5e6, 0.5, -1.0], "scale": 0.25 },
        "sh_degree": 0, "gaussians": 2, "steps": [3, 0], "network_steps": null,
        "queue": [1, 0], "rng": rng, "extent": 1.5, "prune_length": 1.5, "has_planes": false, "overflowed": false,
        "room": 100, "caution": 1.0, "exposure": null, "depths": {}, "telemetry": telemetry, "recorder": recorder });
    let text = |name: &str, value: Value| (name.to_owned(), value.to_string().into_bytes());
    let mut parts = vec![
        text("checkpoint.json", header),
        ("config.toml".to_owned(), config.as_bytes().to_vec()),
        text("state.json", state),
        text("run.json", json!(null)),
    ];
    let mut tensor = |name: &str, values: usize| {
        let bytes = (0..values).flat_map(|v| (v as f32).to_le_bytes()).collect();
        parts.push((format!("tensors/{name}"), bytes));
    };
    // With the words of their packed moments.
    for (name, row, words) in
        [("means", 3, 2), ("rotations", 4, 4), ("scales", 3, 2), ("opacities", 1, 1), ("sh", 3, 2)]
    {
        tensor(name, 2 * row);
        tensor(&format!("{name}.moments"), 2 * words);
    }
    for (name, row) in [("normals", 3), ("offsets", 1), ("statistics", 4)] {
        tensor(name, 2 * row);
    }
    parts
}
