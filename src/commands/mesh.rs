//! `ibgs mesh`

mod compare;
mod finish;
mod truth;

use super::model::{ModelArgs, OpenModel};
use crate::progress::{Bars, bar};
use crate::signals::{self, on_stop};
use crate::stderr;
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::Bytes;
use ibgs_core::local_space::Length;
use ibgs_core::mesh::{DepthMap, FusionOptions, Mesh, MeshError, Plan, fuse, maps_bytes};
use ibgs_core::sources::memory::MemoryBudget;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Voxels between the fused surface and that of a depth map, at most.
const FUSED_WITHIN: f64 = 2.0;

/// Bytes of `--memory auto`.
const USUAL_MEMORY: u64 = 8 << 30;

const EXAMPLES: &str = "\
Examples:
  ibgs mesh output/my-scene -o my-scene.ply
  ibgs mesh output/my-scene --texture -o my-scene.glb";

/// Options of `ibgs mesh`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// File to write, `.ply`, `.obj` or `.glb` [default: MODEL/mesh/ours_N/mesh.ply, with `--texture` mesh.glb].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Side of a voxel in scene units [default: 1/512 of the scene's extent, at least the median size of a pixel on the
    /// surface].
    #[arg(long)]
    voxel_size: Option<f64>,
    /// Truncation of the signed distances, in voxels.
    #[arg(long, default_value_t = 4.0)]
    truncation: f64,
    /// Leave out surfaces farther from the camera than this, in scene units [default: 3 times the median depth].
    #[arg(long)]
    max_depth: Option<f64>,
    /// Mesh only the box x0,y0,z0,x1,y1,z1, in the scene's coordinates [default: everything].
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true)]
    bounds: Vec<f64>,
    /// Leave out depths seen at a larger angle from the surface normal, in degrees.
    #[arg(long, default_value_t = 80.0)]
    max_angle: f64,
    /// Number of connected pieces to keep, the largest first; 0: all.
    #[arg(long, default_value_t = 50)]
    clusters: usize,
    /// Width of the rendered views in pixels [default: that of the photos].
    #[arg(long, value_parser = clap::value_parser!(u32).range(8..))]
    width: Option<u32>,
    /// Memory for the depth maps and, with `--texture`, the photos, and the same again for voxels and mesh: `auto` (8 GiB),
    /// `none` (no limit), or a size such as `2GiB`.
    #[arg(long, default_value = "auto")]
    memory: MemoryBudget,
    #[command(flatten)]
    finish: finish::Options,
    #[command(flatten)]
    compare: compare::Options,
}

/// Set while a file is being written.
static WRITING: AtomicBool = AtomicBool::new(false);

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let mut options = args.fusion()?;
    args.finish.check(args.output.as_deref())?;
    args.compare.check()?;
    let truth = args.compare.read()?;
    // A triangle has one colour for all views, so all are rendered in the same exposure.
    let mut model = args.model.open()?.showing_surface().levelled();
    model.renderer.shape_missing_planes()?;
    options.offset = model.renderer.space().file_offset().unwrap_or_default();
    let cameras = args.cameras(&model)?;
    let name = if args.finish.texture { "mesh.glb" } else { "mesh.ply" };
    let path = args.output.clone().unwrap_or_else(|| model.folder.mesh_path(model.iteration, name));
    let photos = args.finish.photos(&mut model)?;
    let start = Instant::now();
    let maps = render(&model, &cameras, args.max_angle)?;
    let rendered = start.elapsed();
    let (mut mesh, voxel) = build(&maps, &options, args.clusters)?;
    let moved = args.finish.reduce(&mut mesh)?;
    match photos {
        Some(photos) => {
            let textured = args.finish.textured(&mesh, &maps, &photos, FUSED_WITHIN * voxel + moved)?;
            drop((maps, photos));
            write(|| textured.write(&path))?;
        }
        None => {
            drop(maps);
            write(|| mesh.write(&path))?;
        }
    }
    stderr!(
        "{} written: {} triangles, {} vertices; rendered in {:.1} s, meshed in {:.1} s",
        path.display(),
        mesh.triangles.len(),
        mesh.positions.len(),
        rendered.as_secs_f64(),
        (start.elapsed() - rendered).as_secs_f64()
    );
    args.compare.report(truth, &mut model, &mesh, voxel, &cameras)
}

impl Args {
    fn fusion(&self) -> Result<FusionOptions> {
        let bounds = match self.bounds[..] {
            [] => None,
            [x0, y0, z0, x1, y1, z1] => Some([DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)]),
            _ => bail!("`--bounds` has {} numbers; give x0,y0,z0,x1,y1,z1", self.bounds.len()),
        };
        if !(self.max_angle > 0.0 && self.max_angle <= 90.0) {
            bail!("`--max-angle` is {}; choose one from over 0 to 90 degrees", self.max_angle);
        }
        let (voxel, truncation, max_depth) = (self.voxel_size, self.truncation, self.max_depth);
        let memory = self.memory_bytes();
        let options = FusionOptions { voxel, truncation, max_depth, bounds, memory, ..FusionOptions::default() };
        options.check()?;
        Ok(options)
    }

    fn memory_bytes(&self) -> Option<u64> {
        match self.memory {
            MemoryBudget::Auto => Some(USUAL_MEMORY),
            MemoryBudget::Unlimited => None,
            MemoryBudget::Bytes(bytes) => Some(bytes),
        }
    }

    /// Cameras of the training views, at the size to render.
    fn cameras(&self, model: &OpenModel) -> Result<Vec<Camera>> {
        let sized = |camera: &Camera| match self.width {
            Some(width) => {
                let height = f64::from(camera.height) * f64::from(width) / f64::from(camera.width);
                camera.resized(width, (height.round() as u32).max(2))
            }
            None => *camera,
        };
        let training = || model.training_views().into_iter();
        let cameras: Vec<Camera> = training().map(|record| sized(&record.camera)).collect();
        let (photos, what) = match self.finish.texture {
            true => (4 * training().map(|record| record.camera.pixels() as u64).sum::<u64>(), "depth maps and photos"),
            false => (0, "depth maps"),
        };
        let needed = maps_bytes(cameras.iter()) + photos;
        match self.memory_bytes() {
            _ if cameras.is_empty() => bail!("{} has no training views", model.folder.root().display()),
            Some(limit) if needed > limit => {
                Err(MeshError::DepthMaps { what, views: cameras.len(), needed, limit }.into())
            }
            _ => Ok(cameras),
        }
    }
}

/// Renders depths and colours of all views.
fn render(model: &OpenModel, cameras: &[Camera], max_angle: f64) -> Result<Vec<DepthMap>> {
    let bar = bar("rendering", cameras.len());
    let mut maps = Vec::with_capacity(cameras.len());
    for camera in cameras {
        let frame = model.renderer.render(camera)?;
        let depth = frame.depth()?.context("the frame has no depth")?;
        let image = match frame.image()? {
            Some(image) => image,
            None => frame.base()?,
        };
        maps.push(DepthMap::new(*camera, &depth, frame.normals()?.as_deref(), &image.rgb, max_angle));
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(maps)
}

/// Makes the mesh; returns it with the size of its voxels.
fn build(maps: &[DepthMap], options: &FusionOptions, clusters: usize) -> Result<(Mesh, f64)> {
    let plan = Plan::of(maps, options)?;
    let start = Instant::now();
    let grid = fuse(maps, &plan, &Bars::default())?;
    let seconds = start.elapsed().as_secs_f64();
    stderr!(
        "voxels of {}, truncation {}, largest depth {}: {:.1} million in {}, fused in {seconds:.1} s, {:.0} million \
         looked at in a view per second",
        Length(plan.voxel),
        Length(plan.truncation),
        Length(plan.max_depth),
        grid.voxels() as f64 * 1e-6,
        Bytes(grid.bytes()),
        grid.looked_at as f64 * 1e-6 / seconds
    );
    let mut mesh = grid.mesh()?;
    drop(grid);
    let all = mesh.triangles.len();
    let pieces = mesh.keep_largest(clusters);
    if mesh.triangles.len() < all {
        stderr!("the {clusters} largest of {pieces} pieces kept, {} triangles dropped", all - mesh.triangles.len());
    }
    Ok((mesh, plan.voxel))
}

/// Writes the mesh; a signal waits until the file is complete.
fn write(write: impl FnOnce() -> Result<(), MeshError>) -> Result<()> {
    on_stop(|| {
        if !WRITING.load(Ordering::SeqCst) {
            signals::exit_if_stopped();
        }
    });
    WRITING.store(true, Ordering::SeqCst);
    let written = write();
    WRITING.store(false, Ordering::SeqCst);
    signals::exit_if_stopped();
    Ok(written?)
}
