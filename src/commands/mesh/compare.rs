//! Compares a mesh with a true surface.

use super::truth::{TrueSurface, normal_map_errors};
use crate::commands::model::OpenModel;
use crate::stderr;
use crate::stdout;
use anyhow::{Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::camera::Camera;
use ibgs_core::mesh::Mesh;
use ibgs_core::mesh::score::{Cloud, CropVolume, Pair, read_transform, read_truth};
use ibgs_core::output::cameras::Split;
use ibgs_core::output::figures::MESH_FILE;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Default thresholds for the demo scene, in metres.
const DEMO_THRESHOLDS: [f64; 2] = [0.01, 0.02];
/// Default of `--max-distance`, times the density: DTU leaves out distances over 20 at a density of 0.2.
const DENSITIES: f64 = 100.0;

/// Options of the comparison.
#[derive(ClapArgs)]
#[command(next_help_heading = "Comparison with a true surface")]
pub struct Options {
    /// True surface to compare with: a PLY file (points or mesh), or `demo`: that of the demo scene [default: none].
    #[arg(long)]
    compare: Option<PathBuf>,
    /// Largest distance of a match, for precision, recall and F1; several are separated by commas [default: 0.01,0.02
    /// for the demo scene].
    #[arg(long, value_delimiter = ',')]
    threshold: Vec<f64>,
    /// Text file with the 4 x 4 matrix that maps the model to the true surface, such as `Barn_trans.txt`.
    #[arg(long, requires = "compare")]
    transform: Option<PathBuf>,
    /// Volume in which the surfaces are compared: JSON of Open3D's `SelectionPolygonVolume`, in the true surface's
    /// coordinates.
    #[arg(long, requires = "compare")]
    crop: Option<PathBuf>,
    /// Smallest distance between two points, for the Chamfer distance; DTU has 0.2 [default: half the smallest
    /// threshold].
    #[arg(long)]
    density: Option<f64>,
    /// Leave out larger distances from the Chamfer distance; DTU has 20 [default: 100 times the density].
    #[arg(long)]
    max_distance: Option<f64>,
}

/// A true surface from files, with the transform from the mesh to it.
pub struct Truth {
    cloud: Cloud,
    transform: Option<glam::DMat4>,
    crop: Option<CropVolume>,
}

impl Options {
    fn is_demo(&self) -> bool {
        self.compare.as_deref() == Some(Path::new("demo"))
    }

    /// Checks the options and reads the files; none for the demo scene or without a comparison.
    pub fn read(&self) -> Result<Option<Truth>> {
        let lengths = [("--density", self.density), ("--max-distance", self.max_distance)].into_iter();
        let mut given = self.threshold.iter().map(|&t| ("--threshold", Some(t))).chain(lengths);
        let wrong = |value: f64| !(value > 0.0 && value.is_finite());
        if let Some((name, Some(value))) = given.find(|(_, value)| value.is_some_and(wrong)) {
            bail!("`{name}` is {value}; choose a positive number");
        }
        let Some(path) = self.compare.as_ref() else { return Ok(None) };
        if self.is_demo() {
            return match self.transform.is_some() || self.crop.is_some() {
                true => bail!("the demo scene needs neither `--transform` nor `--crop`; leave them out"),
                false => Ok(None),
            };
        }
        if self.threshold.is_empty() {
            bail!("`--compare {}` needs a `--threshold` in the units of that file", path.display());
        }
        let transform = self.transform.as_deref().map(read_transform).transpose()?;
        let crop = self.crop.as_deref().map(CropVolume::read).transpose()?;
        let cloud = read_truth(path, self.spacing())?;
        Ok(Some(Truth { cloud, transform, crop }))
    }

    /// Fails if thresholds are given without a surface to compare with.
    pub fn check(&self) -> Result<()> {
        if self.compare.is_none() && !self.threshold.is_empty() {
            bail!("`--threshold` needs `--compare` with a true surface");
        }
        Ok(())
    }

    fn thresholds(&self) -> &[f64] {
        if self.threshold.is_empty() { &DEMO_THRESHOLDS } else { &self.threshold }
    }

    /// Spacing of the samples on a surface: about one for every voxel of the protocol.
    fn spacing(&self) -> f64 {
        let least = self.thresholds().iter().copied().fold(f64::INFINITY, f64::min);
        (0.5 * least).min(self.density.unwrap_or(f64::INFINITY))
    }

    /// Compares the mesh, prints the result and writes `results_mesh.json`; does nothing without a true surface.
    pub fn report(
        &self,
        truth: Option<Truth>,
        model: &mut OpenModel,
        mesh: &Mesh,
        voxel: f64,
        cameras: &[Camera],
    ) -> Result<()> {
        let sampled = || Cloud::of_mesh(mesh, self.spacing());
        let mut report = match truth {
            Some(Truth { cloud, transform, crop }) => {
                // The spacing is in the units of the true surface.
                let scale = transform.map_or(1.0, |matrix| matrix.determinant().abs().cbrt());
                let mesh = Cloud::of_mesh(mesh, self.spacing() / scale);
                let mesh = transform.into_iter().fold(mesh, Cloud::moved);
                let cropped = |cloud: Cloud| crop.iter().fold(cloud, |cloud, volume| cloud.cropped(volume));
                let (mesh, truth) = (cropped(mesh), cropped(cloud));
                self.compared(&Pair { mesh: &mesh, truth: &truth, wanted: &truth })?
            }
            None if self.is_demo() => {
                stderr!("comparing with the true surface of the demo scene");
                let truth = TrueSurface::sample(cameras, self.spacing());
                self.compared(&Pair { mesh: &sampled(), truth: &truth.all, wanted: &truth.seen })?
            }
            None => return Ok(()),
        };
        report["compared_with"] = json!(self.compare);
        if self.is_demo() {
            report["normal_map"] = normal_map(model)?;
            report["recall_of"] = json!("true triangles whose centre some training view sees");
        }
        report["mesh"] = json!({
            "triangles": mesh.triangles.len(), "vertices": mesh.positions.len(), "voxel_size": voxel, "views": cameras.len(),
        });
        report["icp"] = json!(false);
        Ok(model.folder.write_result(model.iteration, MESH_FILE, report)?)
    }

    fn compared(&self, pair: &Pair) -> Result<Value> {
        let mut scores = Vec::new();
        for &threshold in self.thresholds() {
            let score = pair.f_score(threshold)?;
            let normals = pair.normal_error(threshold)?;
            let angle = normals.map(|angle| format!(", normals off by {angle:.2} degrees")).unwrap_or_default();
            stdout!(
                "within {threshold}: precision {:.4}, recall {:.4}, F1 {:.4}{angle}",
                score.precision,
                score.recall,
                score.f1
            );
            let mut value = serde_json::to_value(score)?;
            value["normal_error_degrees"] = json!(normals);
            scores.push(value);
        }
        let density = self.density.unwrap_or_else(|| self.spacing());
        let chamfer = pair.chamfer(density, self.max_distance.unwrap_or(DENSITIES * density))?;
        let show = |value: Option<f64>| value.map_or("none".to_owned(), |v| format!("{v:.5}"));
        stdout!(
            "accuracy {}, completeness {}, Chamfer distance {}",
            show(chamfer.accuracy),
            show(chamfer.completeness),
            show(chamfer.chamfer)
        );
        Ok(json!({"f_scores": scores, "chamfer": chamfer}))
    }
}

/// Errors of the rendered normals over the held-out views (all views if none were held out).
fn normal_map(model: &OpenModel) -> Result<Value> {
    let any_test = model.cameras.iter().any(|record| record.split == Some(Split::Test));
    let records = model.cameras.iter().filter(|record| !any_test || record.split == Some(Split::Test));
    let (mut angles, mut views) = (Vec::new(), 0);
    for record in records {
        let normals = model.renderer.render(&record.camera)?.normals()?.unwrap_or_default();
        angles.extend(normal_map_errors(&record.camera, &normals));
        views += 1;
    }
    if angles.is_empty() {
        bail!("no view shows a normal");
    }
    let mean = angles.iter().map(|&a| f64::from(a)).sum::<f64>() / angles.len() as f64;
    let middle = angles.len() / 2;
    let median = f64::from(*angles.select_nth_unstable_by(middle, f32::total_cmp).1);
    stdout!("normal map: off by {mean:.2} degrees in the mean, {median:.2} in the median, {views} views");
    Ok(json!({"mean_degrees": mean, "median_degrees": median, "views": views}))
}
