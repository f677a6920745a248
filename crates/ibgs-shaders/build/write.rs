//! The Rust text. It is shown in the documentation, so it looks as rustfmt would leave it.

use super::layout::Struct;
use super::module::Description;
use super::shared::class::KernelSet;
use std::fmt::Write;

/// Adds a line.
macro_rules! line {
    ($text:expr, $($format:tt)*) => {
        // Writing to a string does not fail.
        let _ = writeln!($text, $($format)*);
    };
}

/// Name and text of the files that kernels import.
pub fn shared(files: &[(&str, &str)]) -> String {
    let mut text =
        "/// Name and text of the files that kernels import.\nconst SHARED: &[(&str, &str)] = &[\n".to_string();
    for (name, _) in files {
        line!(text, "    (\"{name}\", {}),", include(&format!("shared/{name}")));
    }
    text.push_str("];\n");
    text
}

/// A file of wgsl/. The path is complete because the text that has it lies elsewhere.
fn include(name: &str) -> String {
    format!("include_str!(concat!(env!(\"CARGO_MANIFEST_DIR\"), \"/wgsl/{name}.wgsl\"))")
}

/// The table of kernels and its parts.
pub fn kernels(kernels: &[Description]) -> String {
    let mut text = String::new();
    for kernel in kernels {
        table_entry(&mut text, kernel);
    }
    for (set, ident, doc) in [
        (KernelSet::Render, "RENDER_KERNELS", "The kernels of rendering, which keep to the limits of a browser."),
        (
            KernelSet::Train,
            "TRAIN_KERNELS",
            "The kernels of training, of measurements, and of frames on devices that have more than a browser's.",
        ),
        (
            KernelSet::Matrix,
            "MATRIX_KERNELS",
            "The kernels that need [`MatrixUnits`]: the residual network in half precision, sums in float32.",
        ),
    ] {
        line!(text, "/// {doc}");
        line!(text, "pub static {ident}: &[&Kernel] = &[");
        for kernel in kernels.iter().filter(|kernel| kernel.header.set == set) {
            line!(text, "    &{},", kernel.name.to_uppercase());
        }
        text.push_str("];\n\n");
    }
    text
}

fn table_entry(text: &mut String, Description { name, file, header, shape }: &Description) {
    doc(text, "", &header.doc);
    line!(text, "pub static {}: Kernel = Kernel {{", name.to_uppercase());
    line!(text, "    name: \"{name}\",");
    line!(text, "    source: {},", include(file));
    line!(text, "    set: KernelSet::{:?},", header.set);
    line!(text, "    stage: KernelStage::{:?},", header.stage);
    line!(text, "    bindings: &[");
    for binding in &shape.bindings {
        let access = if binding.writes { "ReadWrite" } else { "Read" };
        line!(text, "        Binding {{ name: \"{}\", access: Access::{access} }},", binding.name);
    }
    line!(text, "    ],");
    line!(text, "    workgroup: {:?},", shape.workgroup);
    line!(text, "    immediates: {},", shape.immediates.as_ref().map_or(0, |(_, size)| *size));
    text.push_str("};\n\n");
}

/// The structs of immediate data and of buffers.
pub fn types(structs: &[Struct]) -> String {
    let mut text = String::new();
    for Struct { name, doc: own, fields } in structs {
        doc(&mut text, "", own);
        line!(text, "#[repr(C)]");
        line!(text, "#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]");
        line!(text, "pub struct {name} {{");
        for field in fields {
            doc(&mut text, "    ", &field.doc);
            line!(text, "    pub {}: {},", field.name, field.ty);
        }
        text.push_str("}\n\n");
    }
    text
}

/// A struct of named buffers for each kernel.
pub fn bindings(kernels: &[Description]) -> String {
    let mut text = String::new();
    for Description { name, shape, .. } in kernels {
        let (ident, kernel, count) =
            (format!("{}Bindings", camel_case(name)), name.to_uppercase(), shape.bindings.len());
        line!(text, "/// The buffers of [`{kernel}`](crate::{kernel}).");
        line!(text, "#[derive(Debug)]");
        line!(text, "pub struct {ident}<'a, B: UntypedBuffer> {{");
        for binding in &shape.bindings {
            doc(&mut text, "    ", &binding.doc);
            if !binding.doc.is_empty() {
                line!(text, "    ///");
            }
            let access = if binding.writes { "Read and written" } else { "Read" };
            line!(text, "    /// {access}: `{}`.", binding.ty);
            line!(text, "    pub {}: &'a B::Of<{}>,", binding.name, path(&binding.row));
        }
        text.push_str("}\n\n");
        line!(text, "impl<'a, B: UntypedBuffer + 'a> Bindings<'a, B> for {ident}<'a, B> {{");
        line!(text, "    const KERNEL: &'static Kernel = &crate::{kernel};");
        line!(text, "    type Params = {};", shape.immediates.as_ref().map_or("()".to_string(), |(ty, _)| path(ty)));
        line!(text, "    type InOrder = [&'a B; {count}];");
        line!(text, "");
        line!(text, "    fn in_order(&self) -> Self::InOrder {{");
        let fields: Vec<_> =
            shape.bindings.iter().map(|binding| format!("B::untyped(self.{})", binding.name)).collect();
        list(&mut text, "        ", &fields);
        text.push_str("    }\n}\n\n");
    }
    text
}

/// An array, in one line where it fits.
fn list(text: &mut String, indent: &str, values: &[String]) {
    let one_line = format!("{indent}[{}]", values.join(", "));
    if one_line.len() <= 120 {
        line!(text, "{one_line}");
        return;
    }
    line!(text, "{indent}[");
    for value in values {
        line!(text, "{indent}    {value},");
    }
    line!(text, "{indent}]");
}

/// The path of a Rust type that host and kernels share: a number, an array of them, or a struct.
fn path(ty: &str) -> String {
    let is_struct = ty.starts_with(|first: char| first.is_uppercase());
    if is_struct { format!("types::{ty}") } else { ty.to_string() }
}

/// Documentation comments. What looks like a link or a tag is text, unless it has backticks.
fn doc(text: &mut String, indent: &str, lines: &[String]) {
    for own in lines {
        let mut escaped = String::new();
        let mut in_code = false;
        for (at, c) in own.char_indices() {
            in_code ^= c == '`';
            let is_text = match c {
                '[' => !own[at + 1..].starts_with('`'),
                ']' => !own[..at].ends_with('`'),
                '<' => true,
                _ => false,
            };
            if is_text && !in_code {
                escaped.push('\\');
            }
            escaped.push(c);
        }
        line!(text, "{indent}/// {escaped}");
    }
}

/// `half_conv` as `HalfConv`.
fn camel_case(name: &str) -> String {
    let words = name.split('_').map(|word| {
        let mut letters = word.chars();
        letters.next().map(|first| first.to_uppercase().collect::<String>() + letters.as_str()).unwrap_or_default()
    });
    words.collect()
}
