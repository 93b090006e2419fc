"""The number format of the convolutions in training."""

import torch


def fast_bfloat16(device_type: str = "cpu") -> bool:
    """Whether the hardware computes in bfloat16; without, it is ten times slower than float32."""
    return device_type == "cuda" or torch.ops.mkldnn._is_mkldnn_bf16_supported()


def reduced_precision(device_type: str = "cpu") -> torch.autocast:
    """Convolutions in bfloat16 where the hardware computes in it, else in float32."""
    return torch.autocast(device_type, dtype=torch.bfloat16, enabled=fast_bfloat16(device_type))
