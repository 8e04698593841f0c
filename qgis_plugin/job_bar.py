"""A job of the engine in the window: its stage, how far it is, how fast, how long still, and Cancel."""

from __future__ import annotations

from qgis.PyQt.QtCore import pyqtSignal
from qgis.PyQt.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QPushButton, QVBoxLayout, QWidget

from .translation import tr

STEPS = 1000


class JobBar(QWidget):
    """Watches one job at a time. ``done`` carries the command's JSON document; ``failed`` words that say what to do.

    A job that was cancelled is neither: ``cancelled``.
    """

    done = pyqtSignal(object)
    failed = pyqtSignal(str)
    cancelled = pyqtSignal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._job = None
        self._cancelling = False
        self.words = QLabel(self)
        self.words.setWordWrap(True)
        self.bar = QProgressBar(self)
        self.bar.setRange(0, STEPS)
        self.bar.setAccessibleName(tr("Progress"))
        self.cancel_button = QPushButton(tr("&Cancel"), self)
        self.cancel_button.clicked.connect(self.cancel)
        row = QHBoxLayout()
        row.addWidget(self.bar, 1)
        row.addWidget(self.cancel_button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.words)
        layout.addLayout(row)
        self.hide()

    @property
    def busy(self) -> bool:
        """Whether a job is being watched."""
        return self._job is not None

    def watch(self, job, words: str) -> None:
        """Show a job that was just started, until it ends."""
        self._job, self._cancelling = job, False
        self.words.setText(words)
        self.bar.setRange(0, 0)
        self.cancel_button.setEnabled(True)
        self.show()
        job.progress.connect(self._progress)
        job.finished.connect(self._finished)
        job.failed.connect(self._failed)

    def cancel(self) -> None:
        """Ask the job to stop; what it has finished is kept, and the same command goes on from there."""
        if self._job is not None:
            self._cancelling = True
            self.cancel_button.setEnabled(False)
            self.words.setText(tr("Stopping…"))
            self._job.cancel()

    def release(self) -> None:
        """Watch no longer; a job that still runs is told to stop."""
        if self._job is not None:
            job = self._job
            self._forget()
            job.cancel()

    def _progress(self, stage: str, done: float, total: float, rate: float, eta_s: float) -> None:
        if self._cancelling:
            return
        known = total > 0
        self.bar.setRange(0, STEPS if known else 0)
        if known:
            self.bar.setValue(round(STEPS * min(1.0, done / total)))
        self.words.setText(progress_words(stage, done, total, rate, eta_s))

    def _finished(self, document: object) -> None:
        self._forget()
        self.done.emit(document)

    def _failed(self, words: str) -> None:
        cancelling = self._cancelling
        self._forget()
        if cancelling:
            self.cancelled.emit()
        else:
            self.failed.emit(words)

    def _forget(self) -> None:
        job, self._job = self._job, None
        if job is not None:
            job.progress.disconnect(self._progress)
            job.finished.disconnect(self._finished)
            job.failed.disconnect(self._failed)
        self.hide()


def progress_words(stage: str, done: float, total: float, rate: float, eta_s: float) -> str:
    """Return how far a stage is, how fast it goes and how long it still takes; what is unknown (0) is left out."""
    words = [f"{stage}: {done:g}" + (f" / {total:g}" if total > 0 else "")]
    if rate > 0:
        words.append(f"{rate:.1f}/s" if rate < 100 else f"{rate:.0f}/s")
    if eta_s > 0:
        minutes, seconds = divmod(round(eta_s), 60)
        words.append(tr("{} left").format(f"{minutes}:{seconds:02d}"))
    return ", ".join(words)
