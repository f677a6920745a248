"""DirectX's shader compiler through its C interface: `compile` takes HLSL and gives DXIL or SPIR-V.

Its classes begin with QueryInterface, AddRef, Release and, on Linux, the two entries of a virtual destructor.
"""

import ctypes
import uuid

COMPILER = ("73e22d93-e6ce-47f3-b5bf-f0664f39c1b0", "228b4687-5a6a-4730-900c-9702b2203f54")
RESULT = "58346cda-dde7-4497-9461-6f87af5e0659"
UTF8 = 65001
RELEASE, FIRST = 2, 5


class Source(ctypes.Structure):
    _fields_ = [("text", ctypes.c_char_p), ("size", ctypes.c_size_t), ("encoding", ctypes.c_uint32)]


def identifier(text):
    return ctypes.create_string_buffer(uuid.UUID(text).bytes_le, 16)


def call(this, slot, result, *arguments):
    """Calls the method at this place of the object's table; `arguments`: pairs of type and value."""
    table = ctypes.cast(this, ctypes.POINTER(ctypes.POINTER(ctypes.c_void_p))).contents
    method = ctypes.CFUNCTYPE(result, ctypes.c_void_p, *[kind for kind, _ in arguments])(table[slot])
    return method(this, *[value for _, value in arguments])


def succeed(code):
    if code < 0:
        raise RuntimeError(f"DXC fails with {code & 0xFFFFFFFF:#010x}")


def taken(this, slot):
    """The bytes of a blob that a method gives."""
    blob = ctypes.c_void_p()
    succeed(call(this, slot, ctypes.c_int32, (ctypes.c_void_p, ctypes.byref(blob))))
    if not blob:
        return b""
    data = call(blob, FIRST, ctypes.c_void_p), call(blob, FIRST + 1, ctypes.c_size_t)
    copy = ctypes.string_at(*data)
    call(blob, RELEASE, ctypes.c_uint32)
    return copy


class Compiler:
    def __init__(self, library):
        create = ctypes.CDLL(library).DxcCreateInstance
        create.restype = ctypes.c_int32
        self.this = ctypes.c_void_p()
        succeed(create(*map(identifier, COMPILER), ctypes.byref(self.this)))

    def compile(self, text, arguments):
        """The code, or none, and the messages."""
        data = text.encode()
        words = (ctypes.c_wchar_p * len(arguments))(*arguments)
        result = ctypes.c_void_p()
        pointer = ctypes.c_void_p
        succeed(
            call(
                self.this,
                FIRST,
                ctypes.c_int32,
                (pointer, ctypes.byref(Source(data, len(data), UTF8))),
                (pointer, words),
                (ctypes.c_uint32, len(arguments)),
                (pointer, None),
                (pointer, identifier(RESULT)),
                (pointer, ctypes.byref(result)),
            )
        )
        status = ctypes.c_int32()
        succeed(call(result, FIRST, ctypes.c_int32, (pointer, ctypes.byref(status))))
        code = taken(result, FIRST + 1) if status.value >= 0 else None
        messages = taken(result, FIRST + 2).decode(errors="replace").strip("\0\n ")
        call(result, RELEASE, ctypes.c_uint32)
        return code, messages
