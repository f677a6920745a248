"""Deliberately wrong translations of one kernel, each of which the check that is there for it has to find."""

# It has workgroup memory, barriers and parameters.
KERNEL, FORM, HIGHEST = "tile_sort", "plain", "6_7"


def in_main(text, head, line):
    """With a line at the beginning of the entry point."""
    at = text.index("{", text.index(head)) + 1
    return f"{text[:at]}\n    {line}{text[at:]}"


def with_parameters(text, parameters):
    """With more parameters of Metal's entry point."""
    at = text.index("\n) {", text.index("kernel void main_("))
    return text[:at] + "".join(f"\n, {parameter}" for parameter in parameters) + text[at:]


def hlsl(tools, text, kernel):
    def wrong(text):
        return tools.hlsl(text, kernel.entry, kernel.model)[1]

    head, memory = "void main(", "groupshared uint too_much[8193];\n"
    yield "HLSL", True, wrong(text)
    yield "HLSL with an undeclared name", False, wrong(in_main(text, head, "undeclared = 1;"))
    large = in_main(text, head, "too_much[wid.x] = 1;").replace("[numthreads", memory + "[numthreads")
    yield "HLSL with too much workgroup memory", False, wrong(large)
    code, _ = tools.hlsl(text, kernel.entry, HIGHEST, "-spirv", "-fspv-target-env=vulkan1.3")
    yield "SPIR-V", True, tools.spirv(code)
    # The fourth word says how many ids there are.
    yield "SPIR-V with ids that it should not have", False, tools.spirv(code[:12] + bytes([2, 0, 0, 0]) + code[16:])


def msl(check, text):
    head = "kernel void main_("
    yield "MSL", True, check(text)
    yield "MSL with an undeclared name", False, check(in_main(text, head, "undeclared = 1u;"))
    longer = "metal::float3 longer = metal::float2(1.0, 2.0);"
    yield "MSL with a vector of another length", False, check(in_main(text, head, longer))
    yield "MSL with a test for NaN", False, check(in_main(text, head, "bool nan = isnan(1.0);"))
    parameters = text[text.index(head) :]
    for what, most, declaration, own in (
        ("workgroup variable", 31, "threadgroup uint& more{}", parameters.count("\n, threadgroup ")),
        ("buffer", 29, "device uint& more{0} [[buffer({0})]]", parameters.count("[[buffer(")),
    ):
        many = [declaration.format(i) for i in range(own, most + 1)]
        yield f"MSL with as many {what}s as there may be", True, check(with_parameters(text, many[1:]))
        yield f"MSL with a {what} too many", False, check(with_parameters(text, many))


def wgsl(check, text):
    head = "fn main("
    yield "WGSL", True, check(text)
    yield "WGSL with an undeclared name", False, check(in_main(text, head, "let wrong = undeclared;"))
    # naga lets this pass.
    barrier = "if thread > 3u { workgroupBarrier(); }"
    yield "WGSL with a barrier that some threads miss", False, check(in_main(text, head, barrier))


def unwritten(tools, folder, kernel):
    """What naga could not write."""
    for change in {"hlsl": "naga panics"}, {"hlsl": "no matrices in HLSL"}, {"msl": "naga panics"}:
        found, _ = tools.kernel(folder, kernel._replace(**change))
        yield f"a kernel with {change}", False, [line for lines in found.values() for line in lines or []]


def run(tools, folder, kernels, check_msl):
    """Ends the program where a check finds nothing wrong in a wrong text, or something in the right one."""
    kernel = next(k for k in kernels if (k.name, k.form) == (KERNEL, FORM))

    def text(ending):
        return (folder / f"{KERNEL}.{ending}").read_text()

    tests = [
        *hlsl(tools, text("plain.hlsl"), kernel),
        *msl(check_msl, text("plain.msl")),
        *wgsl(tools.tint.check, text("uniform.wgsl")),
        *unwritten(tools, folder, kernel),
    ]
    for title, is_right, wrong in tests:
        if is_right != (not wrong):
            raise SystemExit(f"self-test: {title}: {'; '.join(wrong) or 'nothing is found'}")
        print(f"self-test: {title}: {'nothing' if is_right else wrong[0].splitlines()[0][:120]}")
