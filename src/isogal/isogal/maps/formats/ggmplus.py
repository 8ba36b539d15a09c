"""GGMplus folders as a map format; what is in them: `isogal.maps.ggmplus`."""

from isogal.maps.formats.format import Format
from isogal.maps.ggmplus.folder import is_ggmplus, read_ggmplus

FORMAT = Format("ggmplus", is_ggmplus, read_ggmplus)
