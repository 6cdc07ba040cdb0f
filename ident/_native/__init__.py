"""The compiled kernels: C++ sources and, where it was built, the extension module `_kernel`."""
