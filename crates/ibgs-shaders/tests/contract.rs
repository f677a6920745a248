//! Every form of every kernel, by naga and without a GPU: full validation, limits of devices and browsers, and the bindings and
//! workgroups that the table has from its usual form.

use ibgs_shaders::{
    Access, Bindings, Kernel, KernelSet, MATRIX_KERNELS, MatrixUnits, RENDER_KERNELS, TRAIN_KERNELS, UntypedBuffer,
    bindings, types,
};
use naga::valid::{Capabilities, ShaderStages, SubgroupOperationSet, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess, TypeInner};
use std::marker::PhantomData;

/// Every kernel's module as a GPU gets it, without subgroups and with, and the lanes that it is for; those for matrix units as an
/// H100 and as a software adapter have them.
fn modules() -> Vec<(&'static Kernel, Option<u32>, Module)> {
    let units = [MatrixUnits { side: 16, lanes: 32 }, MatrixUnits { side: 8, lanes: 8 }];
    let half = MATRIX_KERNELS.iter().flat_map(|&kernel| units.map(|u| (kernel, Some(u.lanes), kernel.wgsl_for(u))));
    let usual = || RENDER_KERNELS.iter().chain(TRAIN_KERNELS);
    let subgroups =
        usual().flat_map(|&kernel| [8, 16, 32].map(|lanes| (kernel, Some(lanes), kernel.wgsl_with_subgroups(lanes))));
    let all = usual().map(|&kernel| (kernel, None, kernel.wgsl())).chain(subgroups).chain(half);
    all.map(|(kernel, lanes, source)| (kernel, lanes, parse(kernel, &source))).collect()
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
fn all_forms_have_the_bindings_and_workgroups_of_the_table() {
    for (kernel, lanes, module) in modules() {
        let [entry] = &module.entry_points[..] else { panic!("{}: one entry point", kernel.name) };
        assert_eq!(entry.name, "main", "{}", kernel.name);
        let mut workgroup = entry.workgroup_size;
        let parts = kernel.workgroup.iter().zip(&mut workgroup);
        for (whole, part) in parts.filter(|(whole, part)| lanes == Some(8) && whole.is_multiple_of(**part)) {
            *part = *whole;
        }
        assert_eq!(workgroup, kernel.workgroup, "{}", kernel.name);
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

/// `cargo test kernels::` runs the tests of all kernels. They are in a module with the kernel's name, or the beginning that it shares
/// with others; those of the kernels of a loss are beside it, in a module `kernels` of the file that launches them.
#[test]
fn every_kernel_has_a_module_of_tests() {
    let mut modules: Vec<String> = Vec::new();
    for of in ["render", "train"] {
        let folder = format!("{}/../ibgs-{of}/tests/kernels", env!("CARGO_MANIFEST_DIR"));
        let list = std::fs::read_to_string(format!("{folder}/mod.rs")).unwrap();
        let listed: Vec<&str> = list.lines().filter_map(|line| line.strip_prefix("mod ")?.strip_suffix(';')).collect();
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let file = path.file_stem().unwrap().to_str().unwrap();
            assert!(file == "mod" || listed.contains(&file), "{folder}/{file}.rs is no module");
        }
        modules.extend(listed.into_iter().map(str::to_owned));
    }
    let folder = format!("{}/../ibgs-train/src/loss", env!("CARGO_MANIFEST_DIR"));
    let losses =
        std::fs::read_dir(folder).unwrap().map(|entry| std::fs::read_to_string(entry.unwrap().path()).unwrap());
    let losses: Vec<(String, String)> = losses
        .filter_map(|text| text.split_once("mod kernels {").map(|(own, tests)| (own.into(), tests.into())))
        .collect();
    for kernel in RENDER_KERNELS.iter().chain(TRAIN_KERNELS).chain(MATRIX_KERNELS) {
        let starts = |module: &String| {
            kernel.name.strip_prefix(module.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
        };
        let bindings = format!("{}Bindings {{", kernel.name.replace('_', ""));
        let launched = |(own, tests): &(String, String)| {
            own.to_lowercase().contains(&bindings.to_lowercase()) && tests.contains("#[test]")
        };
        let tested = modules.iter().any(starts) || losses.iter().any(launched);
        assert!(tested, "no module of tests for `{}`", kernel.name);
    }
}

#[test]
fn every_declared_binding_is_used() {
    for (kernel, _, module) in modules() {
        let info = validator().validate(&module).unwrap();
        for (handle, variable) in module.global_variables.iter().filter(|(_, v)| v.binding.is_some()) {
            let used = !info.get_entry_point(0)[handle].is_empty();
            assert!(used, "{}: binding {:?} is not used", kernel.name, variable.name);
        }
    }
}

#[test]
fn workgroup_memory_and_immediates_stay_within_what_every_adapter_is_asked_for() {
    for (kernel, _, module) in modules() {
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let size_of = |space: AddressSpace| -> u32 {
            let of_space = module.global_variables.iter().filter(|(_, v)| v.space == space);
            of_space.map(|(_, v)| layouter[v.ty].size).sum()
        };
        let most = match kernel.set {
            KernelSet::Render => 16,
            KernelSet::Train => 31,
            KernelSet::Matrix => 47,
        };
        let size = size_of(AddressSpace::WorkGroup);
        assert!(size <= most * 1024, "{}: {size} bytes", kernel.name);
        assert_eq!(size_of(AddressSpace::Immediate), kernel.immediates, "{}", kernel.name);
        assert!(kernel.immediates <= 128, "{}", kernel.name);
        // naga translates no others to HLSL.
        let immediate = module.global_variables.iter().find(|(_, v)| v.space == AddressSpace::Immediate);
        let is_struct = immediate.is_none_or(|(_, v)| matches!(module.types[v.ty].inner, TypeInner::Struct { .. }));
        assert!(is_struct, "{}: immediate data is no struct", kernel.name);
    }
}

/// What WebGPU promises: eight storage buffers, 16 KiB of workgroup memory, uniforms in place of immediate data.
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
        assert!(kernel.bindings.len() <= 8, "{}: {} storage buffers", kernel.name, kernel.bindings.len());
        assert!(kernel.workgroup.iter().product::<u32>() <= 256, "{}", kernel.name);
    }
}

/// A buffer that is a name.
struct Named(&'static str);

/// The same with rows.
struct Rows<T>(Named, PhantomData<T>);

impl UntypedBuffer for Named {
    type Of<T> = Rows<T>;

    fn untyped<T>(buffer: &Rows<T>) -> &Self {
        &buffer.0
    }
}

fn rows<T>(name: &'static str) -> Rows<T> {
    Rows(Named(name), PhantomData)
}

/// As a host's function that launches kernels takes them.
fn launched<'a, T: Bindings<'a, Named>>(
    buffers: &T,
    params: &T::Params,
) -> (&'static Kernel, Vec<&'static str>, usize) {
    let names = buffers.in_order().into_iter().map(|buffer| buffer.0);
    (T::KERNEL, names.collect(), bytemuck::bytes_of(params).len())
}

/// Those of the network are found by their names, and by their stages.
#[test]
fn stages_say_which_kernels_are_of_the_network() {
    for kernel in RENDER_KERNELS.iter().chain(TRAIN_KERNELS).chain(MATRIX_KERNELS) {
        let is_named = ["residual_", "half_"].iter().any(|prefix| kernel.name.starts_with(prefix));
        assert_eq!(kernel.stage.is_of_network(), is_named, "{}: {:?}", kernel.name, kernel.stage);
    }
}

#[test]
fn buffers_come_in_binding_order_with_the_parameters_of_their_kernel() {
    let buffers = bindings::PlanesBindings {
        means: &rows("means"),
        planes: &rows("planes"),
        plane_offsets: &rows("plane_offsets"),
        normals: &rows("normals"),
    };
    let (kernel, names, size) = launched(&buffers, &types::ViewUniforms::default());
    assert_eq!(kernel.name, "planes");
    assert_eq!(names, kernel.bindings.iter().map(|binding| binding.name).collect::<Vec<_>>());
    assert_eq!(size, kernel.immediates as usize);
    let (exposures, partials, v_exposure) = (&rows("0"), &rows("1"), &rows("2"));
    let buffers = bindings::ExposeTotalBindings { exposures, partials, v_exposure };
    assert_eq!(launched(&buffers, &()).2, 0);
    let (values, copied) = (&rows("0"), &rows("1"));
    let (_, numbers, size) =
        launched(&bindings::BenchCopyBindings { values, copied }, &types::CountParams { count: 7 });
    assert_eq!((numbers, size), (vec!["0", "1"], 4));
}

/// Each value has the type that it is declared with.
#[test]
fn buffers_have_the_rows_that_their_kernel_declares() {
    let (weights, packed) = (&rows::<f32>("weights"), &rows::<[types::F16; 4]>("packed"));
    let (pairs, output) = (&rows::<types::Pair>("input"), &rows::<[types::F16; 4]>("output"));
    let buffers = bindings::HalfConvBindings { weights, packed, input_a: pairs, input_b: pairs, output };
    assert_eq!(launched(&buffers, &types::HalfConvParams::default()).1[2..], ["input", "input", "output"]);
    let (photos, sources) = (&rows::<u32>("photos"), &rows::<types::SweepSource>("sources"));
    let buffers = bindings::PlaneSweepBindings { photos, sources, found: &rows::<[f32; 2]>("found") };
    assert_eq!(launched(&buffers, &types::SweepParams::default()).1[2], "found");
    // Atomics are numbers to the host.
    let (values, broken) = (&rows::<u32>("values"), &rows::<u32>("broken"));
    assert_eq!(
        launched(&bindings::FiniteBindings { values, broken }, &types::CountParams { count: 7 }).1,
        ["values", "broken"]
    );
}
