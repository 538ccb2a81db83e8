"""Whether pictures can be rendered without a display: a missing driver makes VTK crash."""

import ctypes
from typing import Any

from split_drake.bad_input import BadInputError

_PLATFORM_DEVICE_EXT = 0x313F
_MAX_DEVICES = 16


class RenderingUnavailableError(BadInputError, RuntimeError):
    """The libraries that render without a display are missing."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"depth cameras cannot render: {reason}; on Debian and Ubuntu run "
            "'apt-get install libegl1 libgl1-mesa-dri libglib2.0-0'"
        )


def check_rendering(library: str = "libEGL.so.1") -> None:
    """Raise RenderingUnavailableError where `library` has no device that can be initialized.

    This asks for what VTK will ask for: a display on one of EGL's devices.
    """
    try:
        egl = ctypes.CDLL(library)
    except OSError as error:
        raise RenderingUnavailableError(f"{library} cannot be loaded") from error
    if not any(_initializes(egl, device) for device in _devices(egl)):
        raise RenderingUnavailableError("EGL has no driver that can be initialized")


def _devices(egl: ctypes.CDLL) -> list[int | None]:
    """Return the handles of EGL's devices."""
    signature = (ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))
    query_devices = _extension(egl, "eglQueryDevicesEXT", signature)
    devices = (ctypes.c_void_p * _MAX_DEVICES)()
    count = ctypes.c_int()
    query_devices(_MAX_DEVICES, devices, ctypes.byref(count))
    return list(devices)[: count.value]


def _initializes(egl: ctypes.CDLL, device: int | None) -> bool:
    signature = (ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)
    get_display = _extension(egl, "eglGetPlatformDisplayEXT", signature)
    display = ctypes.c_void_p(get_display(_PLATFORM_DEVICE_EXT, device, None))
    return bool(egl.eglInitialize(display, None, None))


def _extension(egl: ctypes.CDLL, name: str, signature: tuple[Any, ...]) -> Any:
    """Return EGL's extension function `name`; `signature` is (result, *arguments)."""
    if not hasattr(egl, "eglGetProcAddress"):
        raise RenderingUnavailableError("the EGL library has no eglGetProcAddress")
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    address = egl.eglGetProcAddress(name.encode())
    if not address:
        raise RenderingUnavailableError(f"EGL does not know {name}")
    return ctypes.CFUNCTYPE(*signature)(address)
