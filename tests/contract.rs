//! Every kernel against its table entry, by naga and without a GPU: bindings with order and access, workgroup size,
//! struct offsets, full validation.

use ibgs_shaders::{Access, Kernel, MATRIX_KERNELS, MatrixUnits, RENDER_KERNELS, TRAIN_KERNELS, types};
use naga::valid::{Capabilities, ShaderStages, SubgroupOperationSet, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess, TypeInner};
use std::mem::offset_of;

/// Every kernel's module as a GPU gets it, without subgroups and with; those for matrix units as an H100 and as a software
/// adapter have them.
fn modules() -> Vec<(&'static Kernel, Module)> {
    let units = [MatrixUnits { side: 16, lanes: 32 }, MatrixUnits { side: 8, lanes: 8 }];
    let half = MATRIX_KERNELS.iter().flat_map(|&kernel| units.map(|u| (kernel, kernel.wgsl_for(u))));
    let usual = || RENDER_KERNELS.iter().chain(TRAIN_KERNELS);
    let subgroups = usual().flat_map(|&kernel| [8, 16, 32].map(|lanes| (kernel, kernel.wgsl_with_subgroups(lanes))));
    let all = usual().map(|&kernel| (kernel, kernel.wgsl())).chain(subgroups).chain(half);
    all.map(|(kernel, source)| (kernel, parse(kernel, &source))).collect()
}

fn validator() -> Validator {
    let capabilities = Capabilities::IMMEDIATES
        | Capabilities::SHADER_FLOAT16
        | Capabilities::COOPERATIVE_MATRIX
        | Capabilities::SUBGROUP
        | Capabilities::SUBGROUP_BARRIER;
    let mut validator = Validator::new(ValidationFlags::all(), capabilities);
    validator.subgroup_stages(ShaderStages::COMPUTE).subgroup_operations(SubgroupOperationSet::all());
    validator
}

fn parse(kernel: &Kernel, source: &str) -> Module {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|e| panic!("{}: {}", kernel.name, e.emit_to_string(source)));
    validator().validate(&module).unwrap_or_else(|e| panic!("{}: {}", kernel.name, e.emit_to_string(source)));
    module
}

#[test]
fn bindings_and_workgroups_match_the_table() {
    for (kernel, module) in modules() {
        let [entry] = &module.entry_points[..] else { panic!("{}: one entry point", kernel.name) };
        assert_eq!(entry.name, "main", "{}", kernel.name);
        // Those for matrix units have a fixed number of subgroups; the table says what 32 lanes make.
        let lanes_of_8 = kernel.needs_matrix_units() && 4 * entry.workgroup_size[0] == kernel.workgroup[0];
        assert!(lanes_of_8 || entry.workgroup_size == kernel.workgroup, "{}: {:?}", kernel.name, entry.workgroup_size);
        let mut found = 0;
        for (_, variable) in module.global_variables.iter() {
            let Some(binding) = variable.binding else { continue };
            assert_eq!(binding.group, 0, "{}", kernel.name);
            let expected = &kernel.bindings[binding.binding as usize];
            assert_eq!(variable.name.as_deref(), Some(expected.name), "{}", kernel.name);
            let AddressSpace::Storage { access } = variable.space else { panic!("{}: storage only", kernel.name) };
            let writes = access.contains(StorageAccess::STORE);
            assert_eq!(writes, expected.access == Access::ReadWrite, "{}.{}", kernel.name, expected.name);
            found += 1;
        }
        assert_eq!(found, kernel.bindings.len(), "{}", kernel.name);
    }
}

/// `cargo test kernels::NAME` finds the tests of a kernel, by its name or by the beginning that it shares with others.
#[test]
fn every_kernel_has_a_module_of_tests() {
    let mut modules: Vec<String> = Vec::new();
    for of in ["render", "train"] {
        let folder = format!("{}/crates/ibgs-{of}/tests/kernels", env!("CARGO_MANIFEST_DIR"));
        let list = std::fs::read_to_string(format!("{folder}/mod.rs")).unwrap();
        let listed: Vec<&str> = list.lines().filter_map(|line| line.strip_prefix("mod ")?.strip_suffix(';')).collect();
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let file = path.file_stem().unwrap().to_str().unwrap();
            assert!(file == "mod" || listed.contains(&file), "{folder}/{file}.rs is no module");
        }
        modules.extend(listed.into_iter().map(str::to_owned));
    }
    for kernel in RENDER_KERNELS.iter().chain(TRAIN_KERNELS).chain(MATRIX_KERNELS) {
        let starts = |module: &String| {
            kernel.name.strip_prefix(module.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
        };
        assert!(modules.iter().any(starts), "no module of tests for `{}`", kernel.name);
    }
}

#[test]
fn every_declared_binding_is_used() {
    for (kernel, module) in modules() {
        let info = validator().validate(&module).unwrap();
        for (handle, variable) in module.global_variables.iter().filter(|(_, v)| v.binding.is_some()) {
            let used = !info.get_entry_point(0)[handle].is_empty();
            assert!(used, "{}: binding {:?} is not used", kernel.name, variable.name);
        }
    }
}

#[test]
fn workgroup_memory_and_immediates_stay_within_what_every_adapter_is_asked_for() {
    for (kernel, module) in modules() {
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let size_of = |space: AddressSpace| -> u32 {
            let of_space = module.global_variables.iter().filter(|(_, v)| v.space == space);
            of_space.map(|(_, v)| layouter[v.ty].size).sum()
        };
        let most = if kernel.needs_matrix_units() { 47 } else { 31 };
        let size = size_of(AddressSpace::WorkGroup);
        assert!(size <= most * 1024, "{}: {size} bytes", kernel.name);
        assert_eq!(size_of(AddressSpace::Immediate), kernel.immediates, "{}", kernel.name);
        assert!(kernel.immediates <= 128, "{}", kernel.name);
    }
}

/// What browsers offer on desktop adapters: ten storage buffers, 32 KiB of workgroup memory, uniforms in place of immediate data.
#[test]
fn rendering_keeps_to_the_limits_of_browsers() {
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    for kernel in RENDER_KERNELS.iter().chain(TRAIN_KERNELS) {
        let source = kernel.wgsl_with_uniform();
        let module = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|e| panic!("{}: {}", kernel.name, e.emit_to_string(&source)));
        validator.validate(&module).unwrap_or_else(|e| panic!("{}: {}", kernel.name, e.emit_to_string(&source)));
        let uniforms = module.global_variables.iter().filter(|(_, v)| v.space == AddressSpace::Uniform).count();
        assert_eq!(uniforms, usize::from(kernel.immediates > 0), "{}", kernel.name);
    }
    for kernel in RENDER_KERNELS {
        assert!(kernel.bindings.len() <= 10, "{}: {} storage buffers", kernel.name, kernel.bindings.len());
        assert!(kernel.workgroup.iter().product::<u32>() <= 256, "{}", kernel.name);
    }
}

fn check_struct(name: &str, size: usize, fields: &[(&str, usize)]) {
    let mut seen = false;
    for (kernel, module) in modules() {
        for (_, ty) in module.types.iter().filter(|(_, t)| t.name.as_deref() == Some(name)) {
            let TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is a struct") };
            assert_eq!(*span as usize, size, "{name} in {}", kernel.name);
            let actual: Vec<_> = members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset as usize)).collect();
            assert_eq!(actual, fields, "{name} in {}", kernel.name);
            seen = true;
        }
    }
    assert!(seen, "no kernel declares {name}");
}

macro_rules! twin {
    ($ty:ident { $($field:ident),+ $(,)? }) => {
        check_struct(
            stringify!($ty),
            size_of::<types::$ty>(),
            &[$((stringify!($field), offset_of!(types::$ty, $field))),+],
        )
    };
}

#[test]
fn host_structs_have_the_layout_of_their_twins() {
    twin!(HalfWeightsParams { layers, quads });
    twin!(HalfWeights {
        weights,
        stride_out,
        stride_in,
        taps,
        turned,
        channels_a,
        padded_a,
        channels_b,
        padded,
        outputs,
        groups,
        into,
    });
    twin!(HalfConvParams {
        size,
        source,
        mode,
        pairs_a,
        pairs_b,
        quads_out,
        outputs,
        bias,
        packed,
        packed_groups,
        store,
        pad,
    });
    twin!(HalfHeadParams { pixels, fuse_bias, fuse, last_bias, last, keep });
    twin!(HalfHeadGradientParams { pixels, last, scale });
    twin!(HalfHeadBackwardParams { pixels, fuse });
    twin!(HalfConvWeightsParams { size, source, mode, inputs, pairs_in, pairs_out, splits, pad });
    twin!(HalfLinearWeightsParams { pixels, inputs, pairs_in, pairs_out, splits });
    twin!(HalfSumParams { splits, groups_in, groups_out, taps, inputs, outputs, into, stride, bias, unscale });
    twin!(HalfUnpackParams { pixels, channels, quads, unscale });
    twin!(HalfResizeParams { size, source, quads, pad });
    twin!(ViewUniforms {
        row0,
        row1,
        row2,
        focal,
        principal,
        center,
        count,
        size,
        dropout_below,
        dropout_seed,
        background,
        sh_degree,
        sh_coefficients,
        capacity,
        box_sigma,
        tangent_limit,
    });
    twin!(SurfaceUniforms { background, intersections, focal, principal, size, tiles });
    twin!(SourceParams {
        row0,
        row1,
        row2,
        focal,
        principal,
        source_focal,
        source_principal,
        size,
        source_size,
        index,
        visible,
        intersections,
        agreement,
        reach,
        pad0,
        pad1,
    });
    twin!(PresentParams { size, stride, mode, range, most, gain });
    twin!(LossParams { size, tiles, background, object, lambda, visible_index, pad });
    twin!(AdamParams { count, row, head, rate, rate_rest, beta1, beta2, eps, correction1, correction2, decay_rest });
    twin!(GatherParams { count, row, fresh_zero, pad });
    twin!(ExposeParams { background, pixels });
    twin!(VisibleParams { pixels, visible });
    twin!(McmcNoiseParams { count, seed, strength });
    twin!(FilterParams { count, cameras, factor });
    twin!(ObserveParams { size, count, near_depth, largest, errors });
    twin!(OpacityResetParams { count, limit });
    twin!(MeanParams { count, weight });
    twin!(SurfaceParams { size, focal, principal, weight, pad });
    twin!(SweepParams { size, planes, sources, focal, principal, nearest, farthest, pad });
    twin!(FeatureParams {
        row0,
        row1,
        row2,
        focal,
        principal,
        size,
        low,
        visible,
        inputs,
        aggregation,
        groups,
        unscale,
        output,
        pad,
    });
    twin!(FeatureSumParams { count, groups, first, rest });
    twin!(ComposeParams { size, low, gain, output, seen_only, visible });
    twin!(MixParams { pixels, visible, share, angle, doubt });
    twin!(ConvParams {
        size,
        source,
        mode,
        channels_a,
        channels_b,
        outputs,
        weights,
        stride_out,
        stride_in,
        turned,
        bias,
        store,
        groups,
        pad,
    });
    twin!(ConvWeightsParams { size, source, mode, inputs, outputs, splits });
    twin!(SumParams { splits, stride, rows, length, target_offset, target_stride, bias, biases });
    twin!(PoolParams { size, channels, pad });
    twin!(UpsampleParams { size, source, channels, pad });
    twin!(HeadParams { pixels, fuse, fuse_bias, last, last_bias, keep });
    twin!(FmaParams { count, steps });
}
