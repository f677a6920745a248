//! Writes every kernel in every form as HLSL, MSL and WGSL into a folder, with naga's options as wgpu sets them for our kernels, and
//! `list.tsv`, a line for each: kernel, set, form, lowest shader model, entry point in HLSL, what became of HLSL and of MSL.
//! `KERNEL.FORM.vulkan.hlsl` is the same HLSL but for what Vulkan has to find elsewhere: immediate data and the number of
//! workgroups.
//!
//! `cargo run -p ibgs-shaders --features translate --example translate -- FOLDER`

use ibgs_shaders::{Access, Kernel, MATRIX_KERNELS, MatrixUnits, RENDER_KERNELS, TRAIN_KERNELS, with_uniform};
use naga::back::{hlsl, msl};
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ModuleInfo, ShaderStages, SubgroupOperationSet, ValidationFlags, Validator};
use naga::{Module, ResourceBinding, Scalar, ShaderStage, TypeInner};
use std::error::Error;
use std::fmt::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// A kernel in a form, and the form's name.
struct Form {
    kernel: &'static Kernel,
    name: String,
    source: String,
}

/// A kernel as Vulkan, DirectX 12 and Metal get it.
fn native_forms(kernel: &'static Kernel) -> Vec<Form> {
    let form = |name: String, source| Form { kernel, name, source };
    if kernel.needs_matrix_units() {
        let units = [MatrixUnits { side: 16, lanes: 32 }, MatrixUnits { side: 8, lanes: 8 }];
        return units.map(|units| form(format!("matrix{}", units.side), kernel.wgsl_for(units))).into();
    }
    let plain = kernel.wgsl();
    let differs = |source: &str| source.split_once('\n').is_some_and(|(_lanes, rest)| rest != plain);
    let subgroups = [8, 16, 32].map(|lanes| (lanes, kernel.wgsl_with_subgroups(lanes)));
    let mut forms: Vec<Form> = subgroups
        .into_iter()
        .filter(|(_, source)| differs(source))
        .map(|(lanes, source)| form(format!("subgroups{lanes}"), source))
        .collect();
    forms.insert(0, form("plain".into(), plain));
    forms
}

/// The module, validated.
fn parse(source: &str) -> Result<(Module, ModuleInfo), String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|e| e.emit_to_string(source))?;
    let capabilities = Capabilities::IMMEDIATES
        | Capabilities::SHADER_FLOAT16
        | Capabilities::COOPERATIVE_MATRIX
        | Capabilities::SUBGROUP
        | Capabilities::SUBGROUP_BARRIER;
    let mut validator = Validator::new(ValidationFlags::all(), capabilities);
    validator.subgroup_stages(ShaderStages::COMPUTE).subgroup_operations(SubgroupOperationSet::all());
    let info = validator.validate(&module).map_err(|e| e.emit_to_string(source))?;
    Ok((module, info))
}

fn bindings(kernel: &Kernel) -> impl Iterator<Item = (ResourceBinding, bool)> {
    let writes = kernel.bindings.iter().map(|binding| binding.access == Access::ReadWrite);
    (0..).zip(writes).map(|(binding, writes)| (ResourceBinding { group: 0, binding }, writes))
}

/// A register of HLSL.
fn register(space: u8, register: u32) -> hlsl::BindTarget {
    hlsl::BindTarget { space, register, ..Default::default() }
}

/// As wgpu sets them for DirectX 12: registers by kind in binding order, immediate data first, the number of workgroups last.
fn options_of_wgpu(kernel: &Kernel) -> hlsl::Options {
    let mut registers = [0, 0];
    let mut next = |kind: usize| {
        registers[kind] += 1;
        register(0, registers[kind] - 1)
    };
    hlsl::Options {
        shader_model: hlsl::ShaderModel::V6_0,
        binding_map: bindings(kernel).map(|(binding, writes)| (binding, next(usize::from(writes)))).collect(),
        fake_missing_bindings: false,
        special_constants_binding: Some(register(1, u32::from(kernel.immediates > 0))),
        immediates_target: (kernel.immediates > 0).then(|| register(0, 0)),
        zero_initialize_workgroup_memory: false,
        restrict_indexing: true,
        force_loop_bounding: false,
        ..Default::default()
    }
}

/// The same with registers that DXC makes our bindings of, where a uniform takes the place of immediate data.
fn options_for_vulkan(kernel: &Kernel) -> hlsl::Options {
    let uniform = ResourceBinding { group: 1, binding: 0 };
    let own = bindings(kernel).map(|(binding, _)| (binding, register(0, binding.binding)));
    hlsl::Options {
        binding_map: own.chain([(uniform, register(1, 0))]).collect(),
        special_constants_binding: Some(register(2, 0)),
        immediates_target: None,
        ..options_of_wgpu(kernel)
    }
}

/// wgpu gives DirectX 12 the number of workgroups in a register. HLSL has no name for Vulkan's own, so the entry point takes the
/// thread's global number, which `check.py` exchanges for it.
fn with_number_of_workgroups(hlsl: &str, entry: &str) -> Result<String, String> {
    let declared = "ConstantBuffer<NagaConstants> _NagaConstants: register(b0, space2);";
    let read = "uint3(_NagaConstants.first_vertex, _NagaConstants.first_instance, _NagaConstants.other)";
    let head = format!("void {entry}(");
    let text = hlsl.replace(declared, "");
    if !text.contains(read) {
        return if text.contains("_NagaConstants") {
            Err("naga reads its constants in another way".into())
        } else {
            Ok(text)
        };
    }
    if text.contains("SV_DispatchThreadID") || text.matches(&head).count() != 1 {
        return Err("the number of workgroups beside the thread's number is not foreseen".into());
    }
    let text = text.replace(&head, &format!("{head}uint3 number_of_workgroups : SV_DispatchThreadID, "));
    Ok(text.replace(read, "number_of_workgroups"))
}

/// Text and name of the entry point.
fn hlsl(module: &Module, info: &ModuleInfo, options: &hlsl::Options) -> Result<(String, String), String> {
    let mut text = String::new();
    let pipeline = hlsl::PipelineOptions { entry_point: Some((ShaderStage::Compute, "main".into())) };
    let written = hlsl::Writer::new(&mut text, options, &pipeline).write(module, info, None);
    let mut names = written.map_err(|e| e.to_string())?.entry_point_names;
    let name = names.pop().ok_or("no entry point")?.map_err(|e| e.to_string())?;
    Ok((text, name))
}

/// Buffers in the order of immediate data, bindings, sizes.
fn msl(kernel: &Kernel, module: &Module, info: &ModuleInfo) -> Result<String, String> {
    let first = u8::from(kernel.immediates > 0);
    let target =
        |(slot, (binding, mutable))| (binding, msl::BindTarget { buffer: Some(slot), mutable, ..Default::default() });
    let resources = msl::EntryPointResources {
        resources: (first..).zip(bindings(kernel)).map(target).collect(),
        immediates_buffer: (first > 0).then_some(0),
        sizes_buffer: Some(first + u8::try_from(kernel.bindings.len()).map_err(|e| e.to_string())?),
    };
    let options = msl::Options {
        lang_version: (2, 4),
        per_entry_point_map: [("main".to_string(), resources)].into(),
        fake_missing_bindings: false,
        bounds_check_policies: BoundsCheckPolicies {
            index: BoundsCheckPolicy::Restrict,
            buffer: BoundsCheckPolicy::Restrict,
            image_load: BoundsCheckPolicy::Restrict,
            binding_array: BoundsCheckPolicy::Unchecked,
        },
        zero_initialize_workgroup_memory: false,
        force_loop_bounding: false,
        ..Default::default()
    };
    let pipeline = msl::PipelineOptions {
        entry_point: Some((ShaderStage::Compute, "main".into())),
        vertex_pulling_transform: true,
        ..Default::default()
    };
    let (text, written) = msl::write_string(module, info, &options, &pipeline).map_err(|e| e.to_string())?;
    written.entry_point_names.into_iter().collect::<Result<Vec<_>, _>>().map_err(|e| e.to_string())?;
    Ok(text)
}

/// What a writer gives; it may also panic.
fn caught<T>(write: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(write)).unwrap_or_else(|_| Err("naga panics".into()))
}

/// The text for Vulkan and the name of its entry point.
fn vulkan_hlsl(form: &Form) -> Result<(String, String), String> {
    let (module, info) = parse(&with_uniform(&form.source))?;
    let (text, entry) = hlsl(&module, &info, &options_for_vulkan(form.kernel))?;
    Ok((with_number_of_workgroups(&text, &entry)?, entry))
}

/// Writes the texts and gives the line of the list.
fn translate(form: &Form, folder: &Path) -> Result<String, Box<dyn Error>> {
    let Form { kernel, name, source } = form;
    let path = |ending: &str| -> PathBuf { folder.join(format!("{}.{name}.{ending}", kernel.name)) };
    let (module, info) = parse(source).map_err(|e| format!("{}, {name}: {e}", kernel.name))?;
    let is_type = |wanted: fn(&TypeInner) -> bool| module.types.iter().any(|(_, ty)| wanted(&ty.inner));
    let halves = is_type(|ty| ty.scalar() == Some(Scalar::F16));
    let matrices = is_type(|ty| matches!(ty, TypeInner::CooperativeMatrix { .. }));
    let (hlsl, entry) = match caught(|| hlsl(&module, &info, &options_of_wgpu(kernel))) {
        Ok((text, entry)) => {
            std::fs::write(path("hlsl"), text)?;
            let (text, same_entry) = vulkan_hlsl(form).map_err(|e| format!("{}, {name}: {e}", kernel.name))?;
            assert_eq!(same_entry, entry);
            std::fs::write(path("vulkan.hlsl"), text)?;
            ("written".to_string(), entry)
        }
        Err(_) if matrices => ("no matrices in HLSL".to_string(), String::new()),
        Err(e) => (e.replace(['\n', '\t'], " "), String::new()),
    };
    let msl = match caught(|| msl(kernel, &module, &info)) {
        Ok(text) => {
            std::fs::write(path("msl"), text)?;
            "written".to_string()
        }
        Err(e) => e.replace(['\n', '\t'], " "),
    };
    let (set, model) = (kernel.set.name(), if halves { "6_2" } else { "6_0" });
    Ok(format!("{}\t{set}\t{name}\t{model}\t{entry}\t{hlsl}\t{msl}", kernel.name))
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).ok_or("usage: translate FOLDER")?);
    std::fs::create_dir_all(&folder)?;
    let mut list = String::new();
    for &kernel in RENDER_KERNELS.iter().chain(TRAIN_KERNELS).chain(MATRIX_KERNELS) {
        for form in native_forms(kernel) {
            writeln!(list, "{}", translate(&form, &folder)?)?;
        }
    }
    // As browsers get them.
    for kernel in RENDER_KERNELS {
        std::fs::write(folder.join(format!("{}.uniform.wgsl", kernel.name)), kernel.wgsl_with_uniform())?;
    }
    std::fs::write(folder.join("list.tsv"), list)?;
    Ok(())
}
