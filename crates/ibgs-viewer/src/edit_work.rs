//! The editor's part of the worker: it reads the Gaussians from the device, uploads those that are left, and saves
//! them.

use crate::Content;
use anyhow::{Result, bail};
use glam::DVec3;
use ibgs_core::bundle::Packing;
use ibgs_core::camera::Camera;
use ibgs_core::dataset::HostPhoto;
use ibgs_core::edit::{Bases, Mask};
use ibgs_core::model::{Model, is_bundle};
use ibgs_core::render::{PhotoErrors, Removed, Renderer};
use ibgs_core::scene::{Format, Gaussians, Splats, write_gaussians};
use ibgs_core::similarity::Similarity;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Sender;

/// Colour that the selected Gaussians are tinted with: red, green, blue.
const SELECTED: DVec3 = DVec3::new(1.0, 0.47, 0.08);

/// What the editor asks for.
pub enum EditCommand {
    /// The Gaussians of the model that is open.
    Begin,
    /// Show the model in another state. Of several such commands only the last one counts.
    Show(EditShown),
    /// Save what is left.
    Save(Box<SaveEdited>),
    /// Compare what is shown with photos, for the error of each Gaussian. It ends early once nobody receives that.
    Compare(Comparison),
}

/// What is seen of an edited model.
#[derive(Clone, Debug, PartialEq)]
pub struct EditShown {
    /// These Gaussians alone.
    pub left: Arc<Mask>,
    /// Those of them that are tinted in the window; nowhere else.
    pub tinted: Arc<Mask>,
    /// Which state it is.
    pub revision: u32,
}

/// The renderers of such a state.
pub struct EditedRenderers {
    /// Without tint; none where the Gaussians are those of the state before.
    pub plain: Option<Renderer>,
    /// For the window; none where nothing is tinted.
    pub tinted: Option<Renderer>,
}

/// A file that is asked for.
pub struct SaveEdited {
    /// Its ending says what it is.
    pub path: PathBuf,
    /// A file that is there may be replaced.
    pub replaces: bool,
    /// The Gaussians that go into it.
    pub left: Arc<Mask>,
    /// What takes the scene's coordinates to those of the file.
    pub placement: Similarity,
    /// What else a bundle holds.
    pub model: Option<Arc<Model>>,
}

/// What the editor is sent.
pub enum EditMessage {
    /// The Gaussians of the model, those of all its bases in one list.
    Gaussians(Arc<Gaussians>),
    /// A model was saved: what was written, which Gaussians it has and where it stands.
    Saved(String, Arc<Mask>, Similarity),
}

/// Photos to compare a model with.
pub struct Comparison {
    /// Each with its camera.
    pub photos: Vec<(Camera, HostPhoto)>,
    /// They show an object, which lies over the model's background.
    pub of_object: bool,
    /// Who is told of it.
    pub told: Sender<Compared>,
}

/// What is told of the errors of Gaussians.
pub enum Compared {
    /// Photos that were compared with, and their number.
    Photos(usize, usize),
    /// The value of each Gaussian of the whole model; no number for those that no photo sees or that are not shown.
    Values(Vec<f32>),
}

/// What the worker keeps of a model that is edited.
#[derive(Default)]
pub struct EditWork {
    /// All of its Gaussians.
    whole: Option<Bases>,
    asked: Option<EditShown>,
    /// What the renderers have now; none: all.
    left: Option<Arc<Mask>>,
    /// What their photos show besides.
    removed: Option<Arc<Removed>>,
    /// Which state it is now.
    pub revision: u32,
    /// The comparison that is going on.
    comparing: Option<Comparing>,
}

impl EditWork {
    /// That of a model that nobody edits.
    pub fn of_revision(revision: u32) -> Self {
        Self { revision, ..Self::default() }
    }

    /// Does what is asked for. Does nothing to a training.
    ///
    /// # Errors
    /// The device failed, or a file cannot be written.
    pub fn execute(&mut self, content: Option<&Content>, command: EditCommand) -> Result<Option<EditMessage>> {
        let Some(Content::Model(renderer)) = content else { return Ok(None) };
        match command {
            EditCommand::Begin => Ok(Some(EditMessage::Gaussians(self.whole(renderer)?.joined().clone()))),
            EditCommand::Show(shown) => {
                self.asked = Some(shown);
                Ok(None)
            }
            EditCommand::Compare(asked) => {
                self.comparing = Some(Comparing { asked, done: 0, begun: None });
                Ok(None)
            }
            EditCommand::Save(save) => {
                let whole = self.whole(renderer)?;
                // Asked for while another model was opened.
                if whole.joined().len() != save.left.total() {
                    return Ok(None);
                }
                let removed = || removed(renderer, whole, &save.left);
                let text = write(&save, whole.left(&save.left), removed)?;
                Ok(Some(EditMessage::Saved(text, save.left, save.placement)))
            }
        }
    }

    fn whole(&mut self, renderer: &Renderer) -> Result<&Bases> {
        let whole = match self.whole.take() {
            Some(whole) => whole,
            None => downloaded(renderer)?,
        };
        Ok(self.whole.insert(whole))
    }

    /// The renderers of the state that was asked for since the last time, if any.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn renderers(&mut self, content: Option<&Content>) -> Result<Option<EditedRenderers>> {
        let Some(EditShown { left, tinted, revision }) = self.asked.take() else { return Ok(None) };
        let whole = self.whole.as_ref().filter(|whole| whole.joined().len() == left.total());
        let (Some(Content::Model(renderer)), Some(whole)) = (content, whole) else { return Ok(None) };
        // Set even if the upload fails, as no newer command will follow.
        self.revision = revision;
        let is_new = match &self.left {
            Some(before) => **before != *left,
            None => left.count() < left.total(),
        };
        let removed = match is_new {
            true if renderer.part().is_some() => removed(renderer, whole, &left)?,
            true => None,
            false => self.removed.clone(),
        };
        let plain = is_new.then(|| uploaded(renderer, whole.left(&left), &removed)).transpose()?;
        let tint = || uploaded(renderer, whole.tinted(&left, &tinted, SELECTED), &removed);
        let tinted = (tinted.count() > 0).then(tint).transpose()?;
        (self.left, self.removed) = (Some(left), removed);
        Ok(Some(EditedRenderers { plain, tinted }))
    }
}

/// Photos that Gaussians are compared with, one at a time between two frames.
struct Comparing {
    asked: Comparison,
    done: usize,
    /// The model that is compared, which later edits do not change, with the Gaussians that it has of the whole one.
    begun: Option<(Arc<Renderer>, Option<Arc<Mask>>, PhotoErrors)>,
}

impl EditWork {
    /// Whether no photo is left to compare with.
    pub fn is_idle(&self) -> bool {
        self.comparing.is_none()
    }

    /// Compares with the next photo, over the model's own `background`.
    ///
    /// # Errors
    /// The device failed, or a photo cannot be read again.
    pub fn compare(&mut self, content: Option<&Content>, background: [f32; 3]) -> Result<()> {
        let (Some(mut comparing), Some(Content::Model(renderer))) = (self.comparing.take(), content) else {
            return Ok(());
        };
        let (renderer, left, errors) =
            comparing.begun.get_or_insert_with(|| (renderer.clone(), self.left.clone(), PhotoErrors::new(renderer)));
        let mut rest = comparing.asked.photos[comparing.done..].iter();
        if let Some((camera, photo)) = rest.next() {
            HostPhoto::decode_next(rest.map(|(_, photo)| photo));
            let photo = photo.pixels()?;
            renderer.set_background(background);
            match comparing.asked.of_object {
                true => errors.add(renderer, camera, &photo.over(background))?,
                false => errors.add(renderer, camera, &photo)?,
            }
            comparing.done += 1;
        }
        if comparing.done < comparing.asked.photos.len() {
            if comparing.asked.told.send(Compared::Photos(comparing.done, comparing.asked.photos.len())).is_ok() {
                self.comparing = Some(comparing);
            }
            return Ok(());
        }
        let means = errors.means();
        let values = match left {
            Some(left) => {
                let mut whole = vec![f32::NAN; left.total()];
                left.iter().zip(means).for_each(|(i, mean)| whole[i] = mean);
                whole
            }
            None => means,
        };
        // Nobody may want it any more.
        let _ = comparing.asked.told.send(Compared::Values(values));
        Ok(())
    }
}

/// What the photos of a model show besides what is left of it, if anything.
fn removed(renderer: &Renderer, whole: &Bases, left: &Mask) -> Result<Option<Arc<Removed>>> {
    match left.count() < left.total() {
        true => Ok(Some(Arc::new(renderer.removed(&whole.marked(left))?))),
        false => Ok(None),
    }
}

/// A renderer with other Gaussians: those of the first base and of the members.
fn uploaded(
    renderer: &Renderer,
    (first, further): (Gaussians, Vec<Gaussians>),
    removed: &Option<Arc<Removed>>,
) -> Result<Renderer> {
    let with = |renderer: &Renderer, gaussians| -> Result<Renderer> {
        Ok(renderer.with_splats(Splats::upload(gaussians, renderer.gpu())?).hiding(removed.clone()))
    };
    let members = renderer.members().iter().zip(&further).map(|(member, left)| with(member, left));
    let members = members.collect::<Result<_>>()?;
    Ok(with(renderer, &first)?.with_members(members, renderer.alike()))
}

/// The Gaussians of a model on the device.
fn downloaded(renderer: &Renderer) -> Result<Bases> {
    if renderer.stream().is_some() {
        bail!("a model with levels of detail cannot be edited; edit the one that it was exported from");
    }
    let own = |renderer: &Renderer| renderer.splats().download(renderer.gpu());
    let further = renderer.members().iter().map(own).collect::<Result<_, _>>()?;
    Ok(Bases::new(own(renderer)?, further))
}

/// Writes a file and says what it is and what it leaves out. A bundle has every base, and photos in which what was `removed` is
/// hidden; a format of Gaussians alone has room for the first.
fn write(
    save: &SaveEdited,
    (first, further): (Gaussians, Vec<Gaussians>),
    removed: impl FnOnce() -> Result<Option<Arc<Removed>>>,
) -> Result<String> {
    let SaveEdited { path, model, placement, .. } = save;
    if path.as_os_str().is_empty() {
        bail!("give the file a name that ends in `.ply` or `.ibgs`");
    }
    if path.exists() && !save.replaces {
        bail!("{} is there already; choose another name or tick `replace`", path.display());
    }
    let saved = |gaussians: usize| format!("saved: {}, {gaussians} Gaussians", path.display());
    if let Some(format) = Format::of_name(path) {
        let first = first.moved(placement);
        write_gaussians(path, &first, format)?;
        let mut text = saved(first.len());
        if !further.is_empty() {
            text += ", those of the first base alone";
        }
        for loss in format.losses(&first) {
            text += &format!("; {loss}");
        }
        return Ok(text);
    }
    if !is_bundle(path) {
        bail!("{} must end in `.ply` or `.ibgs`, or as another format of Gaussians does", path.display());
    }
    let Some(model) = model else {
        bail!("a bundle holds cameras and photos, which this model does not have; choose a name in `.ply`");
    };
    let text = saved(first.len() + further.iter().map(Gaussians::len).sum::<usize>());
    let mut model = Model::clone(model);
    (model.gaussians, model.levels) = (first, None);
    for (member, gaussians) in model.members.iter_mut().zip(further) {
        member.gaussians = gaussians;
    }
    let cameras: Vec<Camera> = model.training_views().iter().map(|record| record.camera).collect();
    model.place(placement);
    let mut bundle = model.into_bundle(&())?;
    if let Some(removed) = removed()? {
        for ((_, photo), camera) in bundle.photos.iter_mut().zip(&cameras) {
            if let Some(hidden) = removed.hide(camera, photo)? {
                *photo = hidden.into();
            }
        }
    }
    bundle.write(path, Packing::Lossless)?;
    Ok(text)
}
