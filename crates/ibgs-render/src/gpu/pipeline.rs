//! Kernels compiled for the device, each at its first use or all before they are needed.

use super::adapter::{Use, require};
use super::device::Gpu;
use super::error::GpuError;
use super::uniforms::Uniforms;
use ibgs_shaders::{Kernel, KernelSet, KernelStage, MATRIX_KERNELS, RENDER_KERNELS, TRAIN_KERNELS, WARP, WARP_FOUR};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

/// How long compiling takes before it is worth a line.
const PATIENCE: Duration = Duration::from_secs(1);

/// A compiled kernel.
#[derive(Clone)]
pub(super) struct Pipeline {
    pub layout: wgpu::BindGroupLayout,
    pub pipeline: wgpu::ComputePipeline,
}

/// The compiled kernels, by name.
pub(super) type Pipelines = Mutex<HashMap<&'static str, Arc<OnceLock<Pipeline>>>>;

impl Gpu {
    /// Compiles the kernels of a training now, so that no step of it waits for one later; `image_based`: also those that the base
    /// alone does not need.
    ///
    /// # Errors
    /// The device can render, but lacks a limit that training needs.
    pub fn warm_up(&self, image_based: bool) -> Result<(), GpuError> {
        require(&self.info, &self.limits, Use::Training)?;
        self.compile_all(|kernel| image_based || kernel.stage.is_of_base());
        Ok(())
    }

    /// Compiles the kernels that rendering needs, so that the first frame does not wait for one after the other; `network`: also
    /// those of the residual network, but for float32 frames. A browser compiles while the page goes on.
    pub fn warm_up_rendering(&self, network: bool) {
        // The test of the matrix units has backward passes too.
        let tested = network && self.matrix_units.is_some();
        let warp = if self.binds(&WARP_FOUR) { &WARP_FOUR } else { &WARP };
        let renders = |kernel: &Kernel| match kernel.stage {
            KernelStage::Warp => kernel.name == warp.name,
            _ => kernel.set == KernelSet::Render,
        };
        if !cfg!(target_arch = "wasm32") {
            self.compile_all(|kernel| {
                if kernel.stage.is_of_network() { tested || network && renders(kernel) } else { renders(kernel) }
            });
        }
    }

    /// Whether the device binds as many buffers as the kernel has.
    pub(crate) fn binds(&self, kernel: &Kernel) -> bool {
        kernel.bindings.len() <= self.limits.max_storage_buffers_per_shader_stage as usize
    }

    /// Compiles those that are wanted, several at once: a driver may take two seconds for one of them. Says so where all take longer
    /// than one.
    fn compile_all(&self, wanted: impl Fn(&Kernel) -> bool) {
        let matrix = if self.matrix_units.is_some() { MATRIX_KERNELS } else { &[] };
        let mut kernels = [RENDER_KERNELS, TRAIN_KERNELS, matrix].concat();
        kernels.retain(|kernel| wanted(kernel));
        let (start, said, done) = (Instant::now(), AtomicBool::new(false), AtomicUsize::new(0));
        kernels.par_iter().for_each(|&kernel| {
            self.pipeline(kernel);
            let done = 1 + done.fetch_add(1, Ordering::Relaxed);
            if start.elapsed() > PATIENCE && done < kernels.len() && !said.swap(true, Ordering::Relaxed) {
                log::info!("compiling kernels for {}: {done} of {} so far", self.info.name, kernels.len());
            }
        });
    }

    /// The kernel, compiled at its first use.
    pub(super) fn pipeline(&self, kernel: &'static Kernel) -> Pipeline {
        let pipeline = self.pipelines.lock().expect("pipeline cache").entry(kernel.name).or_default().clone();
        // Not under that lock, so that several threads compile several kernels.
        pipeline.get_or_init(|| self.compile(kernel)).clone()
    }

    /// A kernel of ours, with bounds checks but without wgpu's guard against endless loops: it nearly doubles the time of a
    /// loop that does little in each step, and keeps drivers from unrolling it.
    #[expect(unsafe_code, reason = "wgpu asks for it")]
    fn module(&self, label: &str, source: &str) -> wgpu::ShaderModule {
        let checks = wgpu::ShaderRuntimeChecks { force_loop_bounding: false, ..wgpu::ShaderRuntimeChecks::checked() };
        let descriptor =
            wgpu::ShaderModuleDescriptor { label: Some(label), source: wgpu::ShaderSource::Wgsl(source.into()) };
        // SAFETY: every kernel is part of this program, and each of their loops goes in steps of at least 1 to a bound that it
        // does not move.
        unsafe { self.device.create_shader_module_trusted(descriptor, checks) }
    }

    /// Takes a module in place of a kernel's own text, for tests of translations. It has the kernel's bindings, and its entry
    /// point is `main`.
    pub fn replace_kernel(&self, kernel: &'static Kernel, module: &wgpu::ShaderModule) {
        let replaced = OnceLock::from(self.compile_module(kernel, module));
        self.pipelines.lock().expect("pipeline cache").insert(kernel.name, Arc::new(replaced));
    }

    fn compile(&self, kernel: &'static Kernel) -> Pipeline {
        let source = match self.matrix_units.filter(|_| kernel.needs_matrix_units()) {
            Some(units) => kernel.wgsl_for(units),
            None if self.uniforms.is_some() => kernel.wgsl_with_uniform(),
            None => self.subgroup_lanes.map_or_else(|| kernel.wgsl(), |lanes| kernel.wgsl_with_subgroups(lanes)),
        };
        self.compile_module(kernel, &self.module(kernel.name, &source))
    }

    fn compile_module(&self, kernel: &'static Kernel, module: &wgpu::ShaderModule) -> Pipeline {
        let entries: Vec<_> = (0u32..)
            .zip(kernel.bindings)
            .map(|(binding, b)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: b.access == ibgs_shaders::Access::Read },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let layout = self
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(kernel.name), entries: &entries });
        let uniforms = self.uniforms.as_ref().filter(|_| kernel.immediates > 0);
        let groups = [Some(&layout), uniforms.map(Uniforms::layout)];
        let pipeline_layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(kernel.name),
            bind_group_layouts: &groups[..1 + usize::from(uniforms.is_some())],
            immediate_size: if self.uniforms.is_some() { 0 } else { kernel.immediates },
        });
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(kernel.name),
            layout: Some(&pipeline_layout),
            module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        Pipeline { layout, pipeline }
    }
}
