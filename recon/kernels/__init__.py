"""Array operations that know nothing of stereo.

Every function takes and returns tensors. On the CPU most run as compiled loops; on other devices
as tensor operations with the same result.
"""
