"""Files and logs of a vehicle over MAVLink: the FTP and LOG_* microservices, client and server beside each other.

`ftp_files` says which files a server may touch; `ftp` is the wire format of both ends.
"""

__all__ = ["ftp", "ftp_client", "ftp_files", "ftp_server", "log_client", "log_server"]
