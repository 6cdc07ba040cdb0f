"""The formats and simulators that a fit can be exported to, one module each."""
