//! The report of `ibgs eval`, and LPIPS in its figures.

use super::Sandbox;
use crate::lpips_network::write_network;
use serde_json::{Value, json};
use std::fs;

const VIEWS: [&str; 2] = ["images/view_000.png", "images/view_008.png"];

/// Addresses of all pictures of a page.
pub fn sources(html: &str) -> Vec<&str> {
    html.split("src=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

/// Asserts that a page is whole and needs nothing but itself.
#[track_caller]
pub fn assert_self_contained(html: &str) {
    assert!(html.starts_with("<!doctype html>") && html.trim_end().ends_with("</html>"));
    let pictures = sources(html);
    assert!(pictures.iter().all(|source| source.starts_with("data:image/jpeg;base64,/9j/")), "{pictures:?}");
    for word in ["http", "://", "href=", "@import", "url(", "<link", "src='"] {
        assert!(!html.contains(word), "the page holds `{word}`");
    }
}

#[test]
fn the_report_holds_every_view_and_needs_nothing_else() {
    let (sandbox, _) = Sandbox::with_trained();
    // What a name holds is text.
    let name = if cfg!(unix) { "m<b>&\"'" } else { "m&'" };
    fs::rename(sandbox.path("model"), sandbox.path(name)).unwrap();
    sandbox.write(
        "log.json",
        r#"{"entries": [{"iteration": 8, "loss": 0.5, "psnr": 9.0, "gaussians": 300, "seconds": 1.0},
        {"iteration": 20, "loss": 0.25, "psnr": 12.0, "gaussians": 310, "seconds": 2.0}], "spacing": 0}"#,
    );
    fs::rename(sandbox.path("log.json"), sandbox.path(name).join("training_log.json")).unwrap();
    let outcome = sandbox.succeeds(&format!("eval {name}"));
    assert!(outcome.stderr.contains("report.html"), "{outcome}");
    let html = sandbox.text(&format!("{name}/report.html"));
    assert_self_contained(&html);
    let escaped = if cfg!(unix) { "<h1>m&lt;b&gt;&amp;&quot;&#39;</h1>" } else { "<h1>m&amp;&#39;</h1>" };
    assert!(html.contains(escaped), "no heading");
    // Photo, final, base, two errors and the residual of each view.
    assert_eq!(sources(&html).len(), 6 * VIEWS.len());
    let results: Value = sandbox.json(&format!("{name}/per_view_renders_aggregate.json"));
    for view in VIEWS {
        assert!(html.contains(&format!("<h3>{view}</h3>")) && html.contains(&format!("alt=\"final, error, {view}\"")));
        let psnr = results["ours_30"]["PSNR"][view].as_f64().unwrap();
        assert!(html.contains(&format!("<td>{psnr:.3}</td>")), "no PSNR of {view}");
    }
    // Three plots, the measurements at iterations 7 and 30 as marks: base twice, final once.
    assert_eq!((html.matches("class=\"plot\"").count(), html.matches("<circle").count()), (3, 3));
    assert_eq!(html.matches("<polyline").count(), 4, "PSNR of base and photos, loss, Gaussians");
    let verdict = html.split("<p class=\"verdict\">").nth(1).unwrap().split('<').next().unwrap();
    assert!(verdict.starts_with("Final image ") && verdict.contains(" dB. Worst view: images/view_00"), "{verdict}");
    assert!(html.find(verdict) < html.find("<table>") && html.contains("Command line</dt><dd>ibgs train scene "));
    for text in ["iterations = 30", "2 of 10 views", "LPIPS not computed", "Frames a second", "300"] {
        assert!(html.contains(text), "the report does not hold `{text}`");
    }
}

#[test]
fn lpips_is_in_the_table_the_files_and_the_report() {
    let (sandbox, _) = Sandbox::with_trained();
    write_network(&sandbox.path("network.safetensors"));
    let outcome =
        sandbox.succeeds("eval model --lpips-weights network.safetensors --lpips-range published --report page/r.html");
    let mean = outcome.stdout.lines().find(|line| line.starts_with("mean")).unwrap();
    let columns: Vec<f64> = mean.split_whitespace().skip(1).map(|text| text.parse().unwrap()).collect();
    for (kind, column) in [("renders", 2), ("renders_aggregate", 5)] {
        let results = &sandbox.json(&format!("model/results_{kind}.json"))["ours_30"];
        let lpips = results["LPIPS"].as_f64().unwrap();
        assert!(lpips > 0.0 && (columns[column] - lpips).abs() < 1e-4, "{outcome}");
        let views = &sandbox.json(&format!("model/per_view_{kind}.json"))["ours_30"]["LPIPS"];
        let sum: f64 = VIEWS.iter().map(|view| views[view].as_f64().unwrap()).sum();
        assert!((sum / 2.0 - lpips).abs() < 1e-9, "{views}");
        assert!(results["protocol"]["lpips"].as_str().unwrap().contains("left in 0..1"), "{results}");
    }
    let html = sandbox.text("page/r.html");
    assert!(html.contains("left in 0..1") && !sandbox.path("model/report.html").exists());
    // Without weights the old figures do not stay behind.
    sandbox.succeeds("eval model");
    let results = &sandbox.json("model/results_renders.json")["ours_30"];
    assert!(results["LPIPS"].is_null() && results["protocol"]["lpips"].is_null(), "{results}");
}

#[test]
fn bad_wishes_are_answered_before_anything_is_rendered() {
    let (sandbox, _) = Sandbox::with_model();
    sandbox.fails("eval model --lpips-weights none.pth", &["cannot read none.pth"]);
    sandbox.write("text.pth", "no weights");
    sandbox.fails("eval model --lpips-weights text.pth", &["text.pth is not a usable file"]);
    sandbox.write("text.safetensors", "no weights");
    sandbox.fails("eval model --lpips-weights text.safetensors", &["text.safetensors is not a usable file"]);
    sandbox.fails("eval model --report scene", &["scene", "--report"]);
    let arguments = "eval model --lpips-range published";
    sandbox.fails_as(&mut sandbox.command(arguments), arguments, 2, &["required arguments"]);
    sandbox.write("model/training_log.json", json!({"entries": 3}).to_string());
    let outcome = sandbox.run("eval model");
    outcome.assert_failure(1, &["training_log.json is damaged"]);
}
