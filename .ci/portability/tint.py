"""Tint, the compiler of Chromium's WebGPU, in Dawn without a device."""

import logging
import os

import wgpudawn

# Read when an adapter is asked for.
os.environ["WGPU_BACKEND_TYPE"] = "Null"
# It warns of that choice.
logging.getLogger("wgpudawn").setLevel(logging.ERROR)


class Compiler:
    def __init__(self):
        self.device = wgpudawn.gpu.request_adapter_sync().request_device_sync()

    def check(self, text):
        """Errors and warnings."""
        try:
            module = self.device.create_shader_module(code=text)
        except wgpudawn.GPUValidationError as error:
            return [str(error).strip()]
        messages = module.get_compilation_info_sync().messages
        return [f"line {m.line_num}: {m.message}" for m in messages if m.type != "info"]
