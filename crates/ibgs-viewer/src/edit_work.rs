//! The editor's part of the worker: it reads the Gaussians from the device, uploads those that are left, and saves
//! them.

use crate::Content;
use anyhow::{Result, bail};
use glam::DVec3;
use ibgs_core::bundle::Packing;
use ibgs_core::edit::{Bases, Mask};
use ibgs_core::model::{Model, is_bundle};
use ibgs_core::render::Renderer;
use ibgs_core::scene::{Format, Gaussians, Splats, write_gaussians};
use ibgs_core::similarity::Similarity;
use std::path::PathBuf;
use std::sync::Arc;

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

/// What the worker keeps of a model that is edited.
#[derive(Default)]
pub struct EditWork {
    /// All of its Gaussians.
    whole: Option<Bases>,
    asked: Option<EditShown>,
    /// What the renderers have now; none: all.
    left: Option<Arc<Mask>>,
    /// Which state it is now.
    pub revision: u32,
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
            EditCommand::Save(save) => {
                let whole = self.whole(renderer)?;
                // Asked for while another model was opened.
                if whole.joined().len() != save.left.total() {
                    return Ok(None);
                }
                let text = write(&save, whole.left(&save.left))?;
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
        let plain = is_new.then(|| uploaded(renderer, whole.left(&left))).transpose()?;
        let is_tinted = tinted.count() > 0;
        let tinted = is_tinted.then(|| uploaded(renderer, whole.tinted(&left, &tinted, SELECTED))).transpose()?;
        self.left = Some(left);
        Ok(Some(EditedRenderers { plain, tinted }))
    }
}

/// A renderer with other Gaussians: those of the first base and of the members.
fn uploaded(renderer: &Renderer, (first, further): (Gaussians, Vec<Gaussians>)) -> Result<Renderer> {
    let with = |renderer: &Renderer, gaussians| -> Result<Renderer> {
        Ok(renderer.with_splats(Splats::upload(gaussians, renderer.gpu())?))
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

/// Writes a file and says what it is and what it leaves out. A bundle has every base; a format of Gaussians alone has room
/// for the first.
fn write(save: &SaveEdited, (first, further): (Gaussians, Vec<Gaussians>)) -> Result<String> {
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
    model.place(placement);
    model.into_bundle(&())?.write(path, Packing::Lossless)?;
    Ok(text)
}
