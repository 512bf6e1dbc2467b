"""Ultralytics' segmentation trainer, made quick on processors and quiet."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def trainer_class() -> type:
    """The trainer; import it after `load_ultralytics`."""
    import torch  # noqa: PLC0415 - only the training needs it
    from ultralytics.models.yolo.segment import SegmentationTrainer  # noqa: PLC0415 - after load_ultralytics

    class Trainer(SegmentationTrainer):
        """Never validates: the evaluation is ours, and of the file that is shipped."""

        def final_eval(self) -> None:
            return

        def validate(self) -> tuple[dict[str, float], float]:
            return {}, 0.0

        def preprocess_batch(self, batch: dict[str, Any]) -> dict[str, Any]:
            batch = super().preprocess_batch(batch)
            batch["img"] = batch["img"].contiguous(memory_format=torch.channels_last)
            return batch

        def build_optimizer(self, *args: Any, **options: Any) -> Any:
            untyped: Any = super()
            optimizer = untyped.build_optimizer(*args, **options)
            for group in optimizer.param_groups:  # Ultralytics asks for the fused step on GPUs only
                group.update(fused=True, foreach=False)
            return optimizer

    return Trainer


@contextmanager
def quick_arithmetic(threads: int, device: str) -> Iterator[None]:
    """Let torch take its short cuts: numbers next to zero count as zero, and bfloat16 where a processor has it.

    Enter it before torch starts its threads, which take the first over; bfloat16 is about twice as fast as float32.
    """
    import torch  # noqa: PLC0415 - only the training needs it

    bfloat16 = device == "cpu" and torch.cpu._is_avx512_bf16_supported()  # noqa: SLF001 - there is no public name
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    try:
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=bfloat16):
            yield
    finally:
        torch.set_flush_denormal(False)
