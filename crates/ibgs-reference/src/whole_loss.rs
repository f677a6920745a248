//! Twin of the loss of the last stage, (L_img(base) + L_img(final))/2 + L_normal + L_photo (method.md section 7), and of
//! its gradients by the Gaussians and by the network's weights: the other twins chained by hand.

use ibgs_render::residual::Variant;
use ibgs_render::residual::layers::OUTPUTS;

use super::exposure::{Exposure, Image};
use super::features::{Composition, EMPTY, Grads as FeatureGrads, View};
use super::geometry::Geometry;
use super::geometry_backward::{Cotangents, GeometryGrads};
use super::image_loss::{Map, image_loss, image_loss_backward};
use super::normal_loss::{Surface, normal_loss, normal_loss_backward};
use super::photometric_loss::{Masked, photometric_loss, photometric_loss_backward};
use super::surface_scene::{Scene, grad};
use super::unet::{self, Map as Planes};

/// Weight of 1 - SSIM in the image loss.
pub const LAMBDA: f64 = 0.2;
pub const NORMAL: f64 = 0.03;
pub const PHOTO: f64 = 0.3;

/// One training iteration. V = M: every source of the scene can be a visible one.
#[derive(Clone)]
pub struct Case {
    pub scene: Scene,
    /// The target view's photo.
    pub photo: Map,
    /// The network's flat weights.
    pub weights: Vec<f64>,
    pub variant: Variant,
    /// Exposures of the photo and of each source; none where they are not corrected.
    pub exposures: Vec<Exposure>,
    /// Factor of the base colour in the final one.
    pub gain: f64,
    /// Burn-in: L_img(final) teaches the network alone.
    pub detached: bool,
}

/// The parts of the loss, weighted but for the two image losses, of which each counts a half.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Losses {
    pub base: f64,
    pub last: f64,
    pub normal: f64,
    pub photo: f64,
}

impl Losses {
    pub fn total(&self) -> f64 {
        0.5 * (self.base + self.last) + self.normal + self.photo
    }
}

/// Everything between the parameters and the loss.
pub struct Run {
    pub geometry: Geometry,
    /// Colours of visible source m, and whether there is one.
    warped: Vec<Map>,
    visible: Vec<Vec<bool>>,
    /// Number of visible source m of each pixel.
    sources: Vec<Vec<Option<usize>>>,
    /// The base image as it is and in the photo's exposure.
    plain: Image,
    exposed: Map,
    view: View,
    network: unet::Forward,
    pub image: Map,
    pub losses: Losses,
}

/// Gradients by all parameters.
pub struct CaseGrads {
    pub gaussians: GeometryGrads,
    pub weights: Vec<f64>,
    /// By the numbers of the photo's exposure, held fixed where warped colours are brought to it.
    pub exposure: [f64; 6],
}

impl CaseGrads {
    /// One tensor of [`NAMES`].
    pub fn get(&self, name: &str) -> &[f64] {
        if name == "network" { &self.weights } else { grad(&self.gaussians, name) }
    }
}

/// Every trained tensor: those of the Gaussians, then the network's weights.
pub const NAMES: [&str; 8] = ["mean", "rotation", "log_scale", "opacity_logit", "sh", "normal", "offset", "network"];

fn pixels_of(planes: &Planes) -> Vec<[f64; OUTPUTS]> {
    let n = planes.width * planes.height;
    (0..n).map(|i| std::array::from_fn(|c| planes.data[c * n + i])).collect()
}

fn planes_of(map: &[[f64; OUTPUTS]], [width, height]: [usize; 2]) -> Planes {
    let data = (0..OUTPUTS).flat_map(|c| map.iter().map(move |v| v[c])).collect();
    Planes::new(data, width, height)
}

fn halved(map: Map) -> Map {
    map.into_iter().map(|v| v.map(|x| 0.5 * x)).collect()
}

fn add(to: &mut [[f64; 3]], from: &[[f64; 3]]) {
    for (t, f) in to.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
        *t += f;
    }
}

impl Case {
    fn size(&self) -> [usize; 2] {
        [self.scene.camera.width as usize, self.scene.camera.height as usize]
    }

    fn composition(&self, view: &View) -> Composition {
        Composition {
            size: self.size(),
            variant: self.variant,
            gain: self.gain,
            most_visible: view.most_visible,
            seen: view.seen.clone(),
            warped: view.warped.clone(),
        }
    }

    /// One tensor of [`NAMES`].
    pub fn tensor(&mut self, name: &str) -> &mut [f64] {
        if name == "network" { &mut self.weights } else { self.scene.tensor(name) }
    }

    fn photo_exposure(&self) -> Exposure {
        self.exposures.first().copied().unwrap_or_default()
    }

    fn source_exposure(&self, source: usize) -> Exposure {
        self.exposures.get(1 + source).copied().unwrap_or_default()
    }

    /// The loss.
    pub fn run(&self) -> Run {
        let [width, height] = self.size();
        let (geometry, warp) = self.scene.run();
        let pixels = width * height;
        let plain = Image {
            colors: geometry.base.image.clone(),
            transmittance: geometry.base.final_t.clone(),
            background: self.scene.background,
        };
        let own = self.photo_exposure();
        let exposed = plain.exposed(&own);
        let visible: Vec<Vec<bool>> = warp
            .source
            .chunks(pixels)
            .zip(warp.error.chunks(pixels))
            .map(|(sources, errors)| sources.iter().zip(errors).map(|(s, error)| *s >= 0 && *error < 3).collect())
            .collect();
        let sources: Vec<Vec<Option<usize>>> = warp
            .source
            .chunks(pixels)
            .map(|sources| sources.iter().map(|s| usize::try_from(*s).ok()).collect())
            .collect();
        let shifted = |(i, color): (usize, &[f64; 3])| match sources[i / pixels][i % pixels] {
            Some(source) => own.shift(&self.source_exposure(source), *color),
            None => *color,
        };
        let shifted: Map = warp.warped.iter().enumerate().map(shifted).collect();
        let warped: Vec<Map> = shifted.chunks(pixels).map(<[_]>::to_vec).collect();
        let source = |m: usize, p: usize| match warp.source.get(m * pixels + p) {
            Some(&source) if source >= 0 => source as u8 | warp.error[m * pixels + p] << 4,
            _ => EMPTY,
        };
        let features = shifted.iter().zip(&warp.feature);
        let view = View {
            camera: self.scene.camera,
            variant: self.variant,
            base: exposed.clone(),
            warped: features.map(|([r, g, b], feature)| [*r, *g, *b, feature[3]]).collect(),
            seen: (0..pixels).map(|p| std::array::from_fn(|m| source(m, p))).collect(),
            most_visible: sources.iter().filter(|sources| sources.iter().any(Option::is_some)).count(),
            centers: self.centers(),
            weights: self.weights.clone(),
        };
        let [lw, lh] = view.low();
        let network = unet::forward(&self.weights, &Planes::new(view.input(), lw, lh));
        let image = self.composition(&view).compose(&view.base, &pixels_of(&network.residual));
        let valid = vec![true; pixels];
        let masked = Masked { photo: &self.photo, valid: &valid, width, height };
        let losses = Losses {
            base: image_loss(&exposed, &self.photo, width, height, LAMBDA),
            last: image_loss(&image, &self.photo, width, height, LAMBDA),
            normal: normal_loss(
                Surface { camera: &self.scene.camera, valid: &valid },
                &geometry.depth,
                &geometry.normal,
                NORMAL,
            ),
            photo: photometric_loss(&masked, &warped, &visible, PHOTO),
        };
        Run { geometry, warped, visible, sources, plain, exposed, view, network, image, losses }
    }

    fn centers(&self) -> Vec<[f64; 3]> {
        let target = self.scene.camera.center();
        self.scene.sources.iter().map(|s| (target - s.camera.center()).to_array()).collect()
    }

    /// L_img(final)/2 back to the exposed base and warped colours, and to the weights.
    fn last_backward(&self, run: &Run) -> (FeatureGrads, Vec<f64>) {
        let [width, height] = self.size();
        let v_image = halved(image_loss_backward(&run.image, &self.photo, width, height, LAMBDA));
        let composition = self.composition(&run.view);
        let composed = composition.compose_backward(&run.view.base, &pixels_of(&run.network.residual), &v_image);
        let v_residual = planes_of(&composed.residual, composition.low());
        let (v_x, mut weights) = unet::backward(&self.weights, &run.network, &v_residual);
        let mut v = run.view.input_backward(&v_x.data);
        weights.iter_mut().zip(&v.weights).for_each(|(w, v)| *w += v);
        composed.base.iter().for_each(|part| add(&mut v.base, part));
        for (v, composed) in v.warped.as_flattened_mut().iter_mut().zip(composed.warped.as_flattened()) {
            *v += composed;
        }
        (v, weights)
    }

    /// Gradients of the loss.
    pub fn backward(&self, run: &Run) -> CaseGrads {
        let [width, height] = self.size();
        let pixels = width * height;
        let Geometry { normal, depth, .. } = &run.geometry;
        let valid = vec![true; pixels];
        let masked = Masked { photo: &self.photo, valid: &valid, width, height };
        let (last, weights) = self.last_backward(run);
        let surface = Surface { camera: &self.scene.camera, valid: &valid };
        let by_normals = normal_loss_backward(surface, depth, normal, NORMAL);
        let mut v = Cotangents {
            base: halved(image_loss_backward(&run.exposed, &self.photo, width, height, LAMBDA)),
            normal: by_normals.normal,
            depth: by_normals.depth,
            warped: photometric_loss_backward(&masked, &run.warped, &run.visible, PHOTO).concat(),
            cosine: vec![0.0; self.scene.sources.len() * pixels],
        };
        if !self.detached {
            add(&mut v.base, &last.base);
            let colors: Map = last.warped.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
            add(&mut v.warped, &colors);
            v.cosine = last.warped.iter().map(|w| w[3]).collect();
        }
        let own = self.photo_exposure();
        let (v_base, exposure) = run.plain.exposed_backward(&own, &v.base);
        v.base = v_base;
        for (v, source) in v.warped.iter_mut().zip(run.sources.iter().flatten()) {
            let Some(source) = source.map(|source| self.source_exposure(source)) else { continue };
            (0..3).for_each(|c| v[c] *= own.relative_gain(&source, c));
        }
        CaseGrads { gaussians: self.scene.grads(&run.geometry, &v), weights, exposure }
    }
}
