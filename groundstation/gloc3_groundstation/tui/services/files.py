"""Files of the vehicle over MAVLink FTP: folders are walked, files downloaded, uploaded and removed."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.services.files import Folder
from gloc3_groundstation.tui.services.pane import ServicePane
from gloc3_groundstation.tui.views.services.frame import hint_lines
from gloc3_groundstation.tui.views.services.lists import file_line, files_header, files_title
from gloc3_groundstation.tui.widgets.panel import Row

ABOVE = ".."


class FilesPane(ServicePane):
    """The pane of files."""

    service = ServiceKind.FILES
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "fetch", "List", tooltip="lists the folder again"),
        Binding("backspace", "above", "Above", tooltip="the parent folder"),
        Binding("d", "download", "Download", tooltip="the file under the cursor; enter does the same"),
        Binding("u", "upload", "Upload", tooltip="a local file into this folder"),
        Binding("n", "new", "New folder"),
        Binding("delete", "remove", "Remove", tooltip="the file or empty folder under the cursor; asks first"),
    ]

    def fill(self, vehicle: VehicleDesk) -> None:
        """The folder."""
        width, folder = self.list.width, vehicle.listing
        rows = self.rows(lambda: self._rows(folder, width), folder, width)
        self.show(files_header(width), rows, files_title(folder))

    @staticmethod
    def _rows(folder: Folder | None, width: int) -> list[Row]:
        rows = []
        if folder is not None:
            if folder.path != folder.parent:
                rows.append(Row(file_line(ABOVE, None, width), ABOVE))
            rows += [
                Row(file_line(entry.name, None if entry.is_folder else entry.size, width), entry.name)
                for entry in folder.entries
            ]
            rows += [] if folder.entries else [Row(line) for line in hint_lines("The folder is empty.")]
        return rows or [Row(line) for line in hint_lines("f lists the files of the vehicle.")]

    def choose(self, key: str) -> None:
        """Opens a folder, or downloads a file."""
        vehicle = self.vehicle
        if vehicle is None or vehicle.listing is None:
            return
        if key == ABOVE:
            vehicle.list_folder(vehicle.listing.parent)
        for entry in vehicle.listing.entries:
            if entry.name == key and entry.is_folder:
                vehicle.list_folder(vehicle.listing.path_of(entry))
            elif entry.name == key:
                vehicle.download_file(vehicle.listing.path_of(entry))

    def action_fetch(self) -> None:
        """Lists the folder."""
        if self.vehicle is not None:
            self.vehicle.list_folder(self.vehicle.listing.path if self.vehicle.listing is not None else "/")

    def action_above(self) -> None:
        """Goes to the folder above."""
        if self.vehicle is not None and self.vehicle.listing is not None:
            self.vehicle.list_folder(self.vehicle.listing.parent)

    def action_download(self) -> None:
        """Downloads the file under the cursor."""
        self.choose(self.list.chosen)

    def action_upload(self) -> None:
        """Uploads a file."""
        vehicle = self.vehicle
        if vehicle is not None and vehicle.listing is not None:
            folder = vehicle.listing.path
            self.choose_file(f"upload to {folder}", lambda file: vehicle.upload_file(file, folder))

    def action_new(self) -> None:
        """Makes a folder."""
        vehicle = self.vehicle
        if vehicle is not None and vehicle.listing is not None:
            path = vehicle.listing.path.rstrip("/")

            def check(text: str) -> str:
                return "" if text.strip() else "type a name"

            self.prompt(
                f"new folder in {path or '/'}", lambda text: vehicle.make_folder(f"{path}/{text.strip()}"), check=check
            )

    def action_remove(self) -> None:
        """Removes the file or folder under the cursor, after confirmation."""
        vehicle = self.vehicle
        folder = vehicle.listing if vehicle is not None else None
        for entry in folder.entries if folder is not None else ():
            if vehicle is not None and folder is not None and entry.name == self.list.chosen:
                path, is_folder = folder.path_of(entry), entry.is_folder
                self.confirm(
                    f"Remove {path} from {vehicle.name}?",
                    "remove it",
                    lambda path=path, is_folder=is_folder: vehicle.remove_file(path, is_folder=is_folder),  # type: ignore[misc]
                )
