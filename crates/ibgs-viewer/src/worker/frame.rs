//! The frames that the worker renders for the window.

use super::messages::{Message, ModelFacts, Rendered, Request, Sheet};
use super::{Work, WorkerState};
use crate::Content;
use crate::looks::{Look, Looks, rendered};
use anyhow::Result;
use ibgs_core::levels::Stream;
use ibgs_core::picture::usual_range;
use ibgs_core::present::Presenter;
use ibgs_core::render::Frame;
use std::sync::Arc;
use std::time::Duration;
use web_time::Instant;

/// Least time between two readings of the memory in use.
const MEMORY: Duration = Duration::from_secs(1);

impl WorkerState {
    /// Renders a frame with what was asked for beside it, and hands it to the window.
    pub(super) async fn render(&self, work: &mut Work, request: &Request, sheet: Option<&Sheet>) -> Result<()> {
        if work.unfinished {
            // Pending work of a training would count towards the frame's time.
            self.gpu.wait()?;
        }
        work.background = request.background;
        let Some((renderer, iteration)) = work.shown() else { return Ok(()) };
        let start = Instant::now();
        let presenter = match &mut work.presenter {
            Some(presenter) => presenter,
            none => none.insert(Presenter::new(self.gpu.clone())?),
        };
        let mut present = |frame: &Frame, look: Option<Look>| match sheet.filter(|sheet| sheet.mode.look() == look) {
            Some(sheet) => presenter.present(frame, &sheet.mode.shown(&sheet.style, None), &sheet.texture),
            None => Ok(()),
        };
        // Those of a training are of this iteration alone.
        let mut passing = Looks::default();
        let looks = match work.content {
            Some(Content::Model(_)) => &mut work.looks,
            _ => &mut passing,
        };
        // It has waited for the device's answer.
        let frame = rendered(&renderer, &request.camera, |frame| present(frame, None)).await?;
        let looks =
            looks.frames(&renderer, &request.camera, request.looks, |frame, look| present(frame, Some(look))).await?;
        let time = start.elapsed();
        let depths = if request.with_range { frame.depth_async().await? } else { None };
        let further: usize = renderer.members().iter().map(|member| member.splats().len()).sum();
        let facts = ModelFacts {
            gaussians: further + renderer.stream().map_or(renderer.splats().len(), Stream::shown),
            is_loading: renderer.stream().is_some_and(Stream::is_waiting),
            sources: renderer.part().map(|part| part.cameras.clone()),
            most_sources: renderer.part().map_or(1, |part| part.options.sources.visible),
            most_seen: frame.most_visible(),
        };
        let range = depths.as_ref().map(|depths| usual_range(depths));
        let (frame, depths, memory) = (Arc::new(frame), depths.map(Arc::from), self.memory(work));
        let background = request.background;
        let whole = Rendered { frame, range, depths, looks, background, time, facts, memory, iteration };
        self.send(Message::Rendered(Box::new(whole)));
        Ok(())
    }

    /// Device memory in use; asked for now and then, as the answer lists every buffer.
    fn memory(&self, work: &mut Work) -> Option<u64> {
        if work.memory.is_none_or(|(at, _)| at.elapsed() > MEMORY) {
            work.memory = Some((Instant::now(), self.gpu.memory_report().map(|report| report.reserved_bytes)));
        }
        work.memory.and_then(|(_, bytes)| bytes)
    }
}
