#![allow(warnings)]
use ibgs_core::config::{Method, TrainConfig, TransientSwitch};
use ibgs_core::eval::scores::score_test_views;
use ibgs_demo::{DemoOptions, WalkerOptions, WalkerPixel};
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_train::Trainer;
use std::io::Write;

fn var(name: &str, default: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| default.to_owned())
}

fn main() {
    let percent: u32 = var("WALKERS", "15").parse().unwrap();
    let iterations: u32 = var("ITERS", "1000").parse().unwrap();
    let every: u32 = var("DUMP", "100000").parse().unwrap();
    let seed: u64 = var("SEED", "0").parse().unwrap();
    let out = var("OUT", "/tmp/tm/run");
    let switch = match var("T", "on").as_str() {
        "on" => TransientSwitch::On,
        "auto" => TransientSwitch::Auto,
        _ => TransientSwitch::Off,
    };
    let walked = ibgs_demo::walkers(
        &WalkerOptions { scene: DemoOptions { seed: 0, ..DemoOptions::small() }, percent },
        Some(std::path::Path::new("/tmp/tm/cache")),
        &(),
    )
    .unwrap();
    let mut dataset = walked.dataset;
    let odd = var("ODD", "");
    if !odd.is_empty() {
        spoil(&mut dataset, &odd);
    }
    let method = if var("METHOD", "3dgs") == "ibgs" { Method::Ibgs } else { Method::Gs3 };
    let mut config =
        TrainConfig { method, iterations: Some(iterations), seed, deterministic: true, ..TrainConfig::default() };
    config.densify.max_splats = Some(12_000);
    config.transients.mask = switch;
    config.ensemble = Some(1);
    config.residual.factor = Some(0.25);
    config.exposure.enabled = if var("EXPOSURE", "off") == "on" {
        ibgs_core::config::ExposureSwitch::On
    } else {
        ibgs_core::config::ExposureSwitch::Off
    };
    let mut file = std::fs::File::create(format!("{out}.masks")).unwrap();
    for &view in &dataset.train {
        match &walked.masks[view] {
            Some(mask) => file.write_all(&mask.pixels.iter().map(|p| *p as u8).collect::<Vec<u8>>()).unwrap(),
            None => file.write_all(&vec![0; 160 * 120]).unwrap(),
        }
    }
    config.validate().unwrap();
    let mut t = Trainer::new(std::sync::Arc::new(rasterizer()), &dataset, &config).unwrap();
    let start = std::time::Instant::now();
    while t.iteration() < iterations {
        let next = (t.iteration() + every).min(iterations);
        while t.iteration() < next {
            t.step().unwrap();
        }
        if switch != TransientSwitch::Off {
            t.checkpoint(serde_json::Value::Null)
                .unwrap()
                .write(std::path::Path::new(&format!("{out}.{next}.ibgs")))
                .unwrap();
        }
        if let Some(masks) = t.masks() {
            let mut c = [[0u32; 2]; 3];
            for (mask, &view) in masks.iter().zip(&dataset.train) {
                for p in 0..160 * 120u32 {
                    let kind = walked.masks[view].as_ref().map_or(WalkerPixel::Same, |m| m.pixels[p as usize]);
                    let k = match kind {
                        WalkerPixel::Same => 0,
                        WalkerPixel::Shadow => 1,
                        WalkerPixel::Figure => 2,
                    };
                    c[k][usize::from(mask.hides(p % 160, p / 160))] += 1;
                }
            }
            let hid = (c[0][1] + c[1][1] + c[2][1]).max(1);
            println!(
                "it {next} hidden {:.4} precision {:.3} (figure {:.3}) recall figure {:.3} shadow {:.3}",
                f64::from(hid) / (35.0 * 19200.0),
                f64::from(c[1][1] + c[2][1]) / f64::from(hid),
                f64::from(c[2][1]) / f64::from(hid),
                f64::from(c[2][1]) / f64::from((c[2][0] + c[2][1]).max(1)),
                f64::from(c[1][1]) / f64::from((c[1][0] + c[1][1]).max(1))
            );
        }
    }
    if let Some(o) = t.oddities() {
        println!("odd {:?}", o.iter().enumerate().filter(|(_, o)| o.is_some()).collect::<Vec<_>>());
    }
    println!("train views {} seconds {:?} gaussians {}", dataset.train.len(), start.elapsed(), t.splats().len());
    let scores = score_test_views(&t.renderer().unwrap(), &dataset, &config, None, None, &mut |_, _| {}).unwrap();
    println!(
        "{} walkers {percent} T {} seed {seed} iters {iterations}: {}",
        var("METHOD", "3dgs"),
        var("T", "on"),
        scores.sentence()
    );
}

fn spoil(dataset: &mut ibgs_core::dataset::Dataset, odd: &str) {
    let names = ["blur", "dark", "other"];
    for (k, what) in odd.split(',').enumerate() {
        let view = dataset.train[3 + 7 * k];
        let photo = dataset.views[view].photo.pixels().unwrap();
        let (w, h) = (photo.width as i32, photo.height as i32);
        let mut out = (*photo).clone();
        match what {
            "dark" => out.rgba.chunks_mut(4).for_each(|p| (0..3).for_each(|c| p[c] = (p[c] as f32 * 0.75) as u8)),
            "other" => out.rgba.rotate_left(4 * 40 * 160),
            _ => {
                for y in 0..h {
                    for x in 0..w {
                        for c in 0..3 {
                            let mut sum = 0u32;
                            let mut n = 0;
                            for dy in -2..=2 {
                                for dx in -2..=2 {
                                    let (u, v) = (x + dx, y + dy);
                                    if u >= 0 && v >= 0 && u < w && v < h {
                                        sum += photo.rgba[(4 * (v * w + u) + c) as usize] as u32;
                                        n += 1;
                                    }
                                }
                            }
                            out.rgba[(4 * (y * w + x) + c) as usize] = (sum / n) as u8;
                        }
                    }
                }
            }
        }
        println!("spoiled {what}: {}", 3 + 7 * k);
        dataset.views[view].photo = out.into();
    }
}
