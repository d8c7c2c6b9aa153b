"""ROS 2 definitions of what GLOC3 sends and receives: the text of the packages' `.msg` and `.srv` files, as of Iron."""

import re
from typing import Final

_TEXT: Final = """\
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec

MSG: diagnostic_msgs/DiagnosticArray
std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status

MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values

MSG: diagnostic_msgs/KeyValue
string key
string value

MSG: geometry_msgs/Point
float64 x
float64 y
float64 z

MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation

MSG: geometry_msgs/PoseStamped
std_msgs/Header header
geometry_msgs/Pose pose

MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance

MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w

MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation

MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform

MSG: geometry_msgs/Twist
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular

MSG: geometry_msgs/TwistWithCovariance
geometry_msgs/Twist twist
float64[36] covariance

MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z

MSG: lifecycle_msgs/ChangeState_Request
lifecycle_msgs/Transition transition

MSG: lifecycle_msgs/ChangeState_Response
bool success

MSG: lifecycle_msgs/GetState_Request

MSG: lifecycle_msgs/GetState_Response
lifecycle_msgs/State current_state

MSG: lifecycle_msgs/State
uint8 PRIMARY_STATE_UNKNOWN=0
uint8 PRIMARY_STATE_UNCONFIGURED=1
uint8 PRIMARY_STATE_INACTIVE=2
uint8 PRIMARY_STATE_ACTIVE=3
uint8 PRIMARY_STATE_FINALIZED=4
uint8 TRANSITION_STATE_CONFIGURING=10
uint8 TRANSITION_STATE_CLEANINGUP=11
uint8 TRANSITION_STATE_SHUTTINGDOWN=12
uint8 TRANSITION_STATE_ACTIVATING=13
uint8 TRANSITION_STATE_DEACTIVATING=14
uint8 TRANSITION_STATE_ERRORPROCESSING=15
uint8 id
string label

MSG: lifecycle_msgs/Transition
uint8 TRANSITION_CREATE=0
uint8 TRANSITION_CONFIGURE=1
uint8 TRANSITION_CLEANUP=2
uint8 TRANSITION_ACTIVATE=3
uint8 TRANSITION_DEACTIVATE=4
uint8 TRANSITION_UNCONFIGURED_SHUTDOWN=5
uint8 TRANSITION_INACTIVE_SHUTDOWN=6
uint8 TRANSITION_ACTIVE_SHUTDOWN=7
uint8 TRANSITION_DESTROY=8
uint8 id
string label

MSG: nav_msgs/Odometry
std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist

MSG: nav_msgs/Path
std_msgs/Header header
geometry_msgs/PoseStamped[] poses

MSG: rcl_interfaces/Log
byte DEBUG=10
byte INFO=20
byte WARN=30
byte ERROR=40
byte FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line

MSG: sensor_msgs/BatteryState
uint8 POWER_SUPPLY_STATUS_UNKNOWN=0
uint8 POWER_SUPPLY_STATUS_CHARGING=1
uint8 POWER_SUPPLY_STATUS_DISCHARGING=2
uint8 POWER_SUPPLY_STATUS_NOT_CHARGING=3
uint8 POWER_SUPPLY_STATUS_FULL=4
uint8 POWER_SUPPLY_HEALTH_UNKNOWN=0
uint8 POWER_SUPPLY_HEALTH_GOOD=1
uint8 POWER_SUPPLY_HEALTH_OVERHEAT=2
uint8 POWER_SUPPLY_HEALTH_DEAD=3
uint8 POWER_SUPPLY_HEALTH_OVERVOLTAGE=4
uint8 POWER_SUPPLY_HEALTH_UNSPEC_FAILURE=5
uint8 POWER_SUPPLY_HEALTH_COLD=6
uint8 POWER_SUPPLY_HEALTH_WATCHDOG_TIMER_EXPIRE=7
uint8 POWER_SUPPLY_HEALTH_SAFETY_TIMER_EXPIRE=8
uint8 POWER_SUPPLY_TECHNOLOGY_UNKNOWN=0
uint8 POWER_SUPPLY_TECHNOLOGY_NIMH=1
uint8 POWER_SUPPLY_TECHNOLOGY_LION=2
uint8 POWER_SUPPLY_TECHNOLOGY_LIPO=3
uint8 POWER_SUPPLY_TECHNOLOGY_LIFE=4
uint8 POWER_SUPPLY_TECHNOLOGY_NICD=5
uint8 POWER_SUPPLY_TECHNOLOGY_LIMN=6
std_msgs/Header header
float32 voltage
float32 temperature
float32 current
float32 charge
float32 capacity
float32 design_capacity
float32 percentage
uint8 power_supply_status
uint8 power_supply_health
uint8 power_supply_technology
bool present
float32[] cell_voltage
float32[] cell_temperature
string location
string serial_number

MSG: sensor_msgs/CompressedImage
std_msgs/Header header
string format
uint8[] data

MSG: sensor_msgs/Image
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data

MSG: sensor_msgs/Imu
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance

MSG: sensor_msgs/LaserScan
std_msgs/Header header
float32 angle_min
float32 angle_max
float32 angle_increment
float32 time_increment
float32 scan_time
float32 range_min
float32 range_max
float32[] ranges
float32[] intensities

MSG: sensor_msgs/NavSatFix
uint8 COVARIANCE_TYPE_UNKNOWN=0
uint8 COVARIANCE_TYPE_APPROXIMATED=1
uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2
uint8 COVARIANCE_TYPE_KNOWN=3
std_msgs/Header header
sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type

MSG: sensor_msgs/NavSatStatus
int8 STATUS_NO_FIX=-1
int8 STATUS_FIX=0
int8 STATUS_SBAS_FIX=1
int8 STATUS_GBAS_FIX=2
uint16 SERVICE_GPS=1
uint16 SERVICE_GLONASS=2
uint16 SERVICE_COMPASS=4
uint16 SERVICE_GALILEO=8
int8 status
uint16 service

MSG: sensor_msgs/PointCloud2
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense

MSG: sensor_msgs/PointField
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count

MSG: sensor_msgs/Range
uint8 ULTRASOUND=0
uint8 INFRARED=1
std_msgs/Header header
uint8 radiation_type
float32 field_of_view
float32 min_range
float32 max_range
float32 range
float32 variance

MSG: service_msgs/ServiceEventInfo
uint8 REQUEST_SENT=0
uint8 REQUEST_RECEIVED=1
uint8 RESPONSE_SENT=2
uint8 RESPONSE_RECEIVED=3
uint8 event_type
builtin_interfaces/Time stamp
char[16] client_gid
int64 sequence_number

MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id

MSG: std_msgs/String
string data

MSG: std_srvs/Trigger_Request

MSG: std_srvs/Trigger_Response
bool success
string message

MSG: tf2_msgs/TFMessage
geometry_msgs/TransformStamped[] transforms
"""

_SEPARATOR: Final = f"{'=' * 80}\n"
DEFINITIONS: Final = {
    block.partition("\n")[0]: block.partition("\n")[2].strip() + "\n" for block in _TEXT.split("MSG: ") if block
}
"""Type, such as `nav_msgs/Odometry`, to its own definition."""


def definition(kind: str) -> str:
    """The definition of a type with those that it contains, in the form of a bag: `rosbag2` reads it without ROS."""
    kinds = [kind]
    for one in kinds:
        for line in filter(None, DEFINITIONS[one].splitlines()):
            inner = re.sub(r"\[\d*\]$", "", line.split()[0])
            if inner in DEFINITIONS and inner not in kinds:
                kinds.append(inner)
    first, *others = kinds
    return DEFINITIONS[first] + "".join(f"{_SEPARATOR}MSG: {one}\n{DEFINITIONS[one]}" for one in others)
