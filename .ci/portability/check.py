"""Compiles the translated kernels: check.py KERNELS DXC SPIRV_VAL TABLE.

KERNELS is the folder that the example `translate` of ibgs-shaders wrote, DXC the library of DirectX's shader compiler,
SPIRV_VAL the validator of SPIR-V. Writes a table to TABLE and prints a summary. The exit code is 1 where a check fails.
"""

import array
import collections
import concurrent.futures
import os
import pathlib
import subprocess
import sys
import time

import dxc
import metal
import selftest
import tint

# As wgpu sets them. A device with a shader model of 6.2 also gets 16-bit types.
ARGUMENTS = ["-HV", "2018", "-no-warnings", "-Ges", "-O3"]
HALVES = "-enable-16bit-types"
HIGHEST = "6_7"
# It says so of everything on Linux, where the signing library is not to be had.
UNSIGNED = "warning: DXIL.dll not found"
# Numbers of SPIR-V.
DECORATE, BUILT_IN, NUMBER_OF_WORKGROUPS, GLOBAL_INVOCATION_ID = 71, 11, 24, 28
NO_MATRICES = "no matrices in HLSL"
Kernel = collections.namedtuple("Kernel", "name set form model entry hlsl msl")
CHECKS = ["lowest DXIL", "highest DXIL", "SPIR-V", "MSL", "Tint"]


def with_number_of_workgroups(code):
    """SPIR-V with the number of workgroups in place of the thread's global number: in the decoration as a built-in."""
    words = array.array("I", code)
    # Behind the header of five words; an instruction begins with its length and number.
    at, found = 5, 0
    while at < len(words):
        if words[at] == 4 << 16 | DECORATE and list(words[at + 2 : at + 4]) == [BUILT_IN, GLOBAL_INVOCATION_ID]:
            words[at + 3], found = NUMBER_OF_WORKGROUPS, found + 1
        at += words[at] >> 16
    if found != 1:
        raise SystemExit("DXC passes the thread's number in another way")
    return words.tobytes()


class Tools:
    """The compilers of one process. A check gives a list of what is wrong."""

    def __init__(self, library, validator):
        self.dxc, self.tint, self.validator = dxc.Compiler(library), tint.Compiler(), validator

    def hlsl(self, text, entry, model, *more):
        """The code and what is wrong."""
        halves = [] if model == "6_0" else [HALVES]
        code, messages = self.dxc.compile(text, ["-E", entry, "-T", f"cs_{model}", *ARGUMENTS, *halves, *more])
        errors = [line for line in messages.splitlines() if line and not line.startswith(UNSIGNED)]
        return code, [] if code else ["\n".join(errors) or "no code"]

    def spirv(self, code):
        command = [self.validator, "--target-env", "vulkan1.3", "-"]
        run = subprocess.run(command, input=code, capture_output=True)
        return [(run.stderr + run.stdout).decode().strip() or "not valid"] if run.returncode else []

    def hlsl_to_spirv(self, path, entry):
        """Checks the SPIR-V and writes it beside its HLSL, into `FORM/KERNEL.spv`."""
        text = path.read_text()
        code, wrong = self.hlsl(text, entry, HIGHEST, "-spirv", "-fspv-target-env=vulkan1.3")
        if code and "number_of_workgroups" in text:
            code = with_number_of_workgroups(code)
        if code:
            name, form, *_ = path.name.split(".")
            out = path.parent / form / f"{name}.spv"
            out.parent.mkdir(exist_ok=True)
            out.write_bytes(code)
        return wrong or self.spirv(code)

    def kernel(self, folder, kernel):
        """What each check says of a kernel, none where it does not apply; DXC's seconds for the lowest shader model."""
        path = folder / f"{kernel.name}.{kernel.form}"
        found, seconds = dict.fromkeys(CHECKS), None
        has_matrices = kernel.set == "matrix" and kernel.hlsl == NO_MATRICES
        if kernel.hlsl == "written":
            text = path.with_suffix(path.suffix + ".hlsl").read_text()
            start = time.process_time()
            found["lowest DXIL"] = self.hlsl(text, kernel.entry, kernel.model)[1]
            seconds = time.process_time() - start
            found["highest DXIL"] = self.hlsl(text, kernel.entry, HIGHEST)[1]
            found["SPIR-V"] = self.hlsl_to_spirv(path.with_suffix(path.suffix + ".vulkan.hlsl"), kernel.entry)
        elif not has_matrices:
            found["lowest DXIL"] = [kernel.hlsl]
        if kernel.msl != "written":
            found["MSL"] = [kernel.msl]
        elif not has_matrices:
            found["MSL"] = metal.check(path.with_suffix(path.suffix + ".msl").read_text())
        browser = folder / f"{kernel.name}.uniform.wgsl"
        if kernel.form == "plain" and kernel.set == "render":
            found["Tint"] = self.tint.check(browser.read_text())
        return found, seconds


def start(library, validator):
    global tools
    tools = Tools(library, validator)


def checked(folder, kernel):
    return tools.kernel(folder, kernel)


def table(results):
    lines = [f"| kernel | form | {' | '.join(CHECKS)} | s |", "|" + "---|" * (len(CHECKS) + 3)]
    for kernel, (found, seconds) in results:
        cells = ["" if wrong is None else "FAILS" if wrong else "ok" for wrong in found.values()]
        form = kernel.form.replace("subgroups", "subgroups of ").replace("matrix", "matrix units of ")
        cells.append("" if seconds is None else f"{seconds:.2f}")
        lines.append(f"| {kernel.name} | {form} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def summary(results):
    """Prints what was checked, what could not be, and what is wrong; gives how much is wrong."""
    wrong = 0
    for kernel, (found, _) in results:
        for check, messages in found.items():
            for message in messages or []:
                print(f"WRONG: {kernel.name}, {kernel.form}, {check}: {message}")
                wrong += 1
    print(f"{len(results)} kernels and forms")
    for check in CHECKS:
        ran = [found[check] for _, (found, _) in results if found[check] is not None]
        print(f"{check}: {len(ran)} checked, {sum(map(bool, ran))} wrong")
    times = sorted(((seconds, k) for k, (_, seconds) in results if seconds is not None), reverse=True)
    plain = {name: sum(s for s, k in times if k.form == "plain" and k.set == name) for name in ("render", "train")}
    print(f"DXC's time, lowest shader model: rendering {plain['render']:.0f} s, training {plain['train']:.0f} s more")
    print("slowest:", ", ".join(f"{k.name} {k.form} {seconds:.1f} s" for seconds, k in times[:3]))
    matrices = sorted({kernel.name for kernel, _ in results if kernel.hlsl == NO_MATRICES})
    print(f"not checked, as HLSL has no matrices and no Metal device runs them: {', '.join(matrices)}")
    print("not to be had here: Metal's compiler, FXC, DirectX 12 itself")
    return wrong


def main():
    folder, library, validator, out = map(pathlib.Path, sys.argv[1:])
    kernels = [Kernel(*line.split("\t")) for line in (folder / "list.tsv").read_text().splitlines()]
    start(str(library), str(validator))
    selftest.run(tools, folder, kernels, metal.check)
    setup = {"initializer": start, "initargs": (str(library), str(validator))}
    with concurrent.futures.ProcessPoolExecutor(os.cpu_count(), **setup) as pool:
        results = list(zip(kernels, pool.map(checked, [folder] * len(kernels), kernels), strict=True))
    out.write_text(table(results))
    wrong = summary(results)
    print(f"table: {out}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
