"""What photomap's algorithms share: a job of an engine of their own, its progress, its cancel, its errors as words."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProject,
)
from qgis.PyQt.QtGui import QIcon

from ..client import Client, EngineError, Event, JobCancelled, JobFailed
from ..finder import EngineNotFound, find_engine
from ..settings import load_settings
from ..translation import tr
from .fields import Field, further_options
from .held_engine import engine_for

ICON = Path(__file__).parents[1] / "icon.svg"


class EngineAlgorithm(QgsProcessingAlgorithm):
    """An algorithm that is a job. A child says its ``kind``, names and ``fields``, and what its result means.

    It may run on a thread, in a model, in a batch, or without a window: see ``held_engine``.
    """

    kind = ""
    title = ""
    summary = ""
    words = ()

    def fields(self) -> tuple[Field, ...]:
        """Return the fields that become arguments of the job, in the dialog's order."""
        raise NotImplementedError

    def add_outputs(self) -> None:
        """Add destinations and outputs, after the fields."""

    def arguments_for_outputs(
        self, values: Mapping[str, Any], context: QgsProcessingContext, arguments: dict[str, Any]
    ) -> None:
        """Put into ``arguments`` where the job is to write."""

    def outputs_of(
        self, result: Mapping[str, Any], arguments: Mapping[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        """Return the algorithm's outputs by the job's document."""
        raise NotImplementedError

    def name(self) -> str:
        """Return the id within the provider: ``photomap:map`` and so on."""
        return self.kind

    def displayName(self) -> str:
        """Return the title in the toolbox."""
        return tr(self.title)

    def shortDescription(self) -> str:
        """Return one line on what it does."""
        return tr(self.summary)

    def shortHelpString(self) -> str:
        """Return the help beside the dialog."""
        return "".join(f"<p>{tr(paragraph)}</p>" for paragraph in (self.summary, *self.words))

    def tags(self) -> list[str]:
        """Return words by which it is found."""
        return ["photomap", "drone", "uav", "orthophoto", "mosaic", "flight"]

    def icon(self) -> QIcon:
        """Return photomap's icon."""
        return QIcon(str(ICON))

    def createInstance(self) -> EngineAlgorithm:
        """Return another one of its kind, as Processing demands."""
        return type(self)()

    def initAlgorithm(self, configuration: Mapping[str, Any] | None = None) -> None:
        """Add the parameters and outputs."""
        for field in self.fields():
            self.addParameter(field.parameter())
        self.add_outputs()
        self.addParameter(further_options().parameter())

    def processAlgorithm(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, Any]:
        """Run the job to its end; ``QgsProcessingException`` with what to do where it fails."""
        arguments = {}
        for field in self.fields():
            value = field.read(self, parameters, context)
            if value is not None and field.argument:
                arguments[field.argument] = value
        self.arguments_for_outputs(parameters, context, arguments)
        for name, value in further_options().read(self, parameters, context).items():
            arguments[name.replace("-", "_")] = value
        result = self.run_job(self.kind, arguments, feedback)
        return {} if result is None else self.outputs_of(result, arguments, context)

    def run_job(self, kind: str, arguments: Mapping[str, Any], feedback: QgsProcessingFeedback) -> Any:
        """Return a job's document, ``None`` where the user cancelled it."""
        settings = load_settings()
        told: set[str] = set()
        try:
            found = find_engine(settings.engine_path, settings.environment)
            feedback.pushDebugInfo(f"{' '.join(found.command)} ({found.how})")
            return self._followed(engine_for(found.command), kind, arguments, feedback, told)
        except EngineNotFound as error:
            raise QgsProcessingException(str(error)) from error
        except JobCancelled as error:
            feedback.pushInfo(str(error))
            return None
        except JobFailed as error:
            raise QgsProcessingException(error.message) from error
        except EngineError as error:
            raise QgsProcessingException(error.message) from error

    def _followed(
        self,
        client: Client,
        kind: str,
        arguments: Mapping[str, Any],
        feedback: QgsProcessingFeedback,
        told: set[str],
    ) -> Any:
        stage = [""]

        def hear(event: Event) -> None:
            data = event.data
            if event.name == "progress":
                if data["stage"] != stage[0]:
                    stage[0] = data["stage"]
                    feedback.setProgressText(stage[0])
                if data["total"]:
                    feedback.setProgress(100.0 * data["done"] / data["total"])
            elif event.name == "log":
                line = data["line"]
                if line.startswith("warning: "):
                    told.add(line[len("warning: ") :])
                    feedback.pushWarning(line[len("warning: ") :])
                elif not line.startswith("photomap: "):  # that one comes as the exception
                    feedback.pushInfo(line)

        result = client.run_job(kind, arguments, on_event=hear, cancelled=feedback.isCanceled)
        for warning in result.get("warnings") or () if isinstance(result, dict) else ():
            if warning not in told:
                feedback.pushWarning(str(warning))
        return result


def load_when_done(path: str, name: str, output: str, context: QgsProcessingContext) -> None:
    """Have QGIS add a file to the project when the algorithm is done; without a project nothing is loaded."""
    project: QgsProject | None = context.project()
    if project is not None:
        context.addLayerToLoadOnCompletion(path, QgsProcessingContext.LayerDetails(name, project, output))
