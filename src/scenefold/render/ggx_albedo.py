"""What a GGX surface reflects of even light: a table of directional albedos, made once by tools/make_ggx_albedo.py.

E is the share that GGX (height-correlated Smith, one bounce, Fresnel term 1) gives back towards a cosine, B that with a Fresnel
term of (1 - V.H)^5; so Schlick's term f0 + (f90 - f0)(1 - V.H)^5 gives back f0 (E - B) + f90 B. Whole numbers, so that all nodes read
the same. What is computed here is sums and products in a fixed order, rounded as IEEE 754 says.

After Kulla and Conty, Revisiting Physically Based Shading at Imageworks (2017).
"""

from __future__ import annotations

import base64
from typing import Final, NamedTuple

import numpy as np

from scenefold.render.arrays import F64, U32

NODES: Final = 48
ALPHA_MIN: Final = 1e-3
"""Smoother surfaces are rendered as this smooth: their density still fits the ray record's pdf code."""

_CODE = """
NgUz9GsTLefHF9PjywgA8esCU/MmAUfwiAD76kgAV+QpAK3cGgAo1BEA58oLAAnBCACptgYA4asEANGgAwCRlQIAQIoCAPZ+AgDPcwEA4mgBAEZeAQARVAEAVEoBACFB
AQCEOAAAiDAAADUpAACPIgAAmRwAAFEXAAC1EgAAvA4AAF8LAACUCAAATQYAAH4EAAAXAwAACQIAAEcBAADAAAAAaAAAADMAAAAWAAAACAAAAAIAAAAAAAAAAAAAAAAA
NgUz9GsTLefHF9PjywgA8esCU/MmAUfwiAD76kgAV+QpAK3cGgAo1BEA58oLAAnBCACptgYA4asEANGgAwCRlQIAQIoCAPZ+AgDPcwEA4mgBAEZeAQARVAEAVEoBACFB
AQCEOAAAiDAAADUpAACPIgAAmRwAAFEXAAC1EgAAvA4AAF8LAACUCAAATQYAAH4EAAAXAwAACQIAAEcBAADAAAAAaAAAADMAAAAWAAAACAAAAAIAAAAAAAAAAAAAAAAA
7gIZ8iQMDeqhG8fc6RMY5BQJF+zuA8Xs2wEk6fkAROOOAP7bVwCw0zgAksomAMrAGgB5thMAvasOALSgCwB7lQgAL4oHAOl+BQDEcwQA2mgDAEBeAwAMVAIAUUoCAB5B
AgCCOAEAhzABADQpAQCPIgEAmRwBAFIXAQC1EgEAvQ4BAGALAACUCAAATgYAAH4EAAAXAwAACQIAAEcBAADAAAAAaAAAADMAAAAWAAAACAAAAAIAAAAAAAAAAAAAAAAA
UQGd6cQFIuYtE5Pbohss1REYTNizD8PdFAmb3yoFWd0IAzDY3AEh0TIBxcjOAHq/jgB+tWYA/qpLACGgOQAJlSsA1YkjAKN+GwCOcxYAsGgSACBeDwD0UwwAP0oLABFB
CQB5OAgAgTAHADEpBgCNIgUAmRwFAFIXBAC2EgQAvg4DAGILAwCWCAMATwYDAH8EAgAYAwIACgICAEcBAgDBAAIAaQACADMAAgAWAAIACAACAAIAAgAAAAEAAAABAAAA
vgC73k8D89wlDLzWUxaDz6Qb18vOGQbN7BPsz8gNItEWCWHP8QXkyvADUMSsAju83QEUs1YBKqn7ALqevADzk48A/YhwAPt9WQALc0cASmg6ANJdMAC5UygAE0ohAPJA
HABjOBgAcjAVACgpEgCIIhAAlxwOAFMXDAC4EgsAwQ4KAGULCQCaCAgAUwYIAIIEBwAbAwYADQIGAEkBBQDCAAUAagAFADQABAAWAAQACAAEAAIABAAAAAQAAAADAAAA
egDG0iMCv9EkCP3NbRCuyPYXwsOoGzTBpxpAwX8WSsJeEWTCuQx1wBkJRrx6BiG2pAR0rmADo6V/AgOc4AHakW8BW4cdAbV84QANcrQAhWeRADtdeABFU2MAvElTALJA
RgA1ODsAUzA0ABQpLAB+IicAkhwiAFMXHgC7EhsAxg4XAGsLFQCgCBQAWQYSAIgEEAAgAw8AEQIOAEwBDQDEAAsAawALADUACgAXAAoACAAJAAIACQAAAAcAAAAHAAAA
VQBVxn8BscXKBUfDLQyXvzkTYbvuGMW3sBugtSIb4LQhGJi0+ROns8IPQLEUDBStIgk4p+IG8J82BYyX+wNbjhMDnoRnApB65wFhcIYBOWY9ATlcBAGBUtgAKEm1AERA
mQDmN4MAHDBwAPAoYgBoIlUAiBxMAFAXQwC+EjwAzA41AHMLMQCpCC0AYgYoAJAEJQAnAyMAFwIgAFEBHQDIABwAbgAbADcAGQAYABcACQAWAAIAFgAAABUAAAAVAAAA
PwDIuRwBWrlSBLa3SAkatUMP0rEeFWmulBl/q74bbalyGw+oNhnTpt0VBqUtEh2irg7RnacLH5grCS+RNAc9iawFi4B/BFZ3lwPVbeQCOmRaAq1a7gFQUZoBQEhXAZc/
IgFoN/YAwy/TALMotwBCIp8AcxyMAEcXewC+Em4A0g5iAH0LWQC0CFAAbgZJAJwEQwAxAz0AHwI4AFgBNQDNADEAcgAtADkAKwAZACkACQAnAAMAIwABACIAAAAhAAAA
MQBgrdsAEa1bA+OrSgf4qUEMcKeaEYukehaioRAaCJ/RG+CcrxsEm/0ZFJlHF52WGRRDk+YQz47yDTiJYQuWgjwJFHt8B+lyFAZKavUEamERBHZYWwOXT8sC70ZXApg+
+gGsNq8BOy9yAVYoPwEFIhYBTxzzADYX1gC6Er4A1w6pAIcLmQDCCIkAfAZ9AKoEcgA+A2gAKgJgAGEBWADUAFIAdwBNAD0ASAAbAEMACwBAAAMAPQABADgAAAA0AAAA
JwBIobAADaGxAiig4gWxngUKs5y2Dk2aahOsl4MXB5V1GomS7Rs5kOYb9o2YGoCLYRiMiKkV3ITIEkmA/w/LenYNcnQ8C19tWQm9ZcUHu115BoVVaAVFTYoEIUXWAzc9
QgOjNckCei5lAs0nFAKpIdABFByXARYXaAGtEkEB1w4eAZALAwHPCOkAjAbVALoEwgBNA7QAOAKlAGwBmgDdAJAAfQCGAEEAfwAeAHgADABxAAQAbAABAGkAAABmAAAA
IQCilZEAc5U4Ar6U3QSTk1kI9pFsDPaPvRCpjd0UMItZGKmI0hophhYcrYMiHBmBHBtCfkgZ9nryFgt3YRRpcswRCm1aD/xmIA1YYCoLQFl5Cd1RCQhWStMGz0LQBWo7
+QRENEUEdS2wAxEnNAMmIcwCvxt0AuMWKwKTEu0B0A64AZULiwHcCGUBnQZEAcwEJwFfAw8BRwL5AHkB5wDnANYAhQDIAEYAvAAiALAADgCnAAUAngACAJQAAACOAAAA
HACFinsAXorgAciJHQTQiBcHeIejCsWFhg7Dg3MShYETFh1/EhmefDEbEHpNHGp3ZByZdJQbfnEPGvltDhjuaccVT2VpExpgGBFbWusOJlTxDJlNMAvVRqgJ/D9VCC45
NAeJMj0GJSxsBRkmuwR1ICUERxumA5cWOgNoEt8CvQ6RApMLTgLlCBUCrAbiAd8EuQFxA5MBWQJzAYgBVgHzAD4BjQAoAUwAFQEmAAUBEAD0AAYA6AACAN4AAQDOAAAA
GAD9f2sA3H+fAVx/jQOIfiEGYH0+Ced7ugwkel8QHnjuE+R1IheAc8AZ/XCXG1xukhyWa7McmmgOHFRlyRqxYQ8ZnV0LFxNZ5BQTVLkSp06kEORIsQ7hQuoMujxTC402
7Al0MLIIiSqiB+MktwaTH+0FqBo/BS0WqgQoEisEmw69A4cLXgPoCA0DuAbFAvAEiAKEA1MCagIkApgB/AEAAdgBlwC5AVQAngEqAIUBEwBxAQgAWwEDAEwBAQBBAQAA
FgAUdl8A9nVvAYZ1IQPMdGYFx3MnCHtySQvpcKMOFm8HEgptQBXNahsYZ2hqGtxlCRwrY+0cTWAVHThdlBzdWYIbMVYBGilSNxjDTUIWAkk+FPFDQRKhPlsQJzmXDpkz
+AwSLoMLqCg2CnAjEQl+Hg8I4BktB6MVaQbPEb8FZw4rBW8LqQTjCDkEwAbYA/4EggOVAzgDfAL3AqgBvgIOAYsCogBfAlwAOAIwABYCFwD1AQoA3AEEAMABAQCqAQAA
FADNbFcAs2xKAU5szgKma9UEvWpPB5JpJAooaDcNgGZoEKBkjROMYnwWSmAMGd9dGRtNW44ckVhgHahVjh2IUiUdLE89HIlL7hqdR1cZaEORF/A+tBU+OtUTYjUBEm0w
RRB1K6cOjCYqDcgh0gs5HZwK8BiHCfgUkghbEboHHw78BkcLVAbTCMEFvwZABQgFzwSkA2oEjQITBLgBxQMcAYEDrgBEA2QADwM1AN8CGgC2AgwAjwIFAHACAgBNAgAA
EwApZFAAEWQwAbRjkAIbY2cER2KlBjdhOwnsXxEMaV4PD69cFRLDWv4UqFitF2JW/Rn0U9cbXlErHaBO6h22Sx0em0jLHUpFBx3BQeUb/z18GgU64hjcNSsXjDFqFSMt
rBOxKPwRRyRiEPUf5A7LG4QN2hdCDCwUHwvMEBkKwQ0vCQ4LXwi2CKUHtgYABwsFbgavA+0FnAJ6BcgBFQUqAboEuQBqBG0AIgQ8AOMDHgCqAw4AeAMGAEkDAgAlAwAA
EgAlXEwADlwcAbhbYgIrWxMEZ1okBmxZhgg8WCgL11b2DUBV1hB4U7ATglFnFmJP3BgbTfkarkqqHBtI3h1iRZQegULMHnY/jx5APOod3DjtHE01qRuYMTUawS2gGNUp
+hbdJVIV6CGxEwQeHxI/GqEQphY9D0UT8w0lEMUMTg2xC8QKtwqLCNYJogYMCQcFVgi1A7QHpwIjB9UBoAY3AS0GxQDFBXYAaAVCABUFIgDKBBAAiAQHAEwEAgATBAEA
EQC7VEkAplQOAVZUQALSU9UDHFPBBTNS+QcZUXAKzk8UDVRO0w+tTJcS2kpIFd9Izxe+RhUaeUQIHBJClB2IP7Me3TxhHxA6nx8fN3AfDDTjHtcwBR6DLeYcFiqVG5Ym
IRoNI5kYgx8IFwUceBWfGPITXBV6EkYSFhFoD8kPxwyTDmoKdg1TCHAMhAaBC/sEqQq1A+QJrgIzCd8BlAhCAQMIzwCCB34ADgdIAKQGJgBGBhMA8AUIAKUFAwBeBQEA
EQDnTUcA000EAYdNKAILTacDYEx5BYdLkQd/SuQJS0lmDOtHBg9hRrIRr0RXFNdC5BbbQEEZvT5hG388LR0jOp4eqjevHxM1UyBhMpMgky90IKws/x+tKT8fmiZBHngj
Eh1OIL8bJR1RGgQa1xj2FlgXBRTdFTgRbRSaDgsTMAy8EQAKgBAOCFoPWgZJDuYETQ2vA2YMsQKTC+cB0gpMASQK2ACFCYYA9AhOAHIIKwD6BxUAkQcJAC0HBADYBgEA
EQCgR0cAjUf/AEVHGQLQRokDL0ZFBWJFRQdrRH0JS0PiCwJCZw6TQP4Q/j6XE0Y9IxZsO4wYdDnIGl43whwsNXIe4TLPH34wzCADLm4hcyu1Ic4opSEYJkchUyOfIIMg
ux+tHace2RpuHQwYGxxOFbYaqBJKGSEQ3hfADXcWjAsaFYoJyxO9B40SJwZgEckESBChA0IPrgJQDusBcQ1TAaMM4ADmC40AOgtUAJwKLwANChgAiAkLABIJBACgCAEA
EgDfQUcAzUH9AIhBEQIZQXcDgUAlBb8/EwfXPjUJyD2EC5Q89A08O3kQwjkGEyc4ixVuNvsXmDRKGqcyZRyeMEQefi7dH0osJCEBKhkiqCe7Ij8lCCPIIgIjRiCzIr4d
IyIyG1shqBhjICUWRh+wEw0eTxHAHAgPaRvhDAwa4AqxGAoJXRdiBxEW6gXTFKMEpBONA4QSpgJ4EeoBexBXAZAP5gC3DpMA7Q1ZADUNMwCJDBoA7QsMAF0LBQDhCgEA
EgCcPEgAijz+AEg8DwLeO24DTTsUBZY69Qa7OQoJvDhKC5o3qg1YNiAQ9jSgEnYzIBXaMZQXJDDtGVYuIhxyLCQeeyrtH3EobyFWJqsiLiSaI/ohOCS7H4kkdR2RJCsb
ViTfGN4jlxYvI1YUUiIhEk0h/g8qIPEN8h4ADKsdMApdHIQIDBsAB78ZpgV4GHcEOhdzAwkWmQLkFOYBzxNYAcsS6gDUEZgA8BBeABkQNgBTDx0Amw4OAO8NBQBRDQEA
EgDNN0kAvDcBAX03EgIXN3ADjTYQBd816wYPNfYIHjQqCw4zfw3eMesPkjBkEisv4RSqLVcXEiy4GWQq/xujKBwe0CYLIO0kviH9IjQjASFlJPweTCXwHOwl3hpHJssY
Xia4FjMmqRTMJaISMSWmEGskug5+I+IMcyIjC1IhfwkgIPsH4h6aBqAdXAVcHEUEHBtTA+MZhwKyGN4BjRdWAXQW7ABpFZwAbRRhAH4TOQCeEh8AyxEPAAgRBgBLEAIA
EwBqM0wAWjMHAR0zGgK8MnkDODIZBZIx8AbNMPgI6S8nC+cudg3JLdwPkSxREkErzBTZKUIXXCisGcsmAhwpJTQeeCNCILkhHSLvH8QjHB4tJUEcVCZiGjsnfxjiJ5wW
QSi7FGEo3xJGKAsR9SdCD3Inhw3EJt8L8iVMCv8k0QjyI3IH0iIxBqQhDwVuIA8ENR8vA/wdcQLGHNIBlxtRAXAa6wBVGZ0AQxhkAD8XPABGFiEAXBUQAH0UBwCxEwIA
FABsL04AXC8OASEvJgLELokDRS4rBactBQfsLAwJEyw6Cx8rhw0SKuwP7ChgEq8n2xReJlUX+iTIGYQjKhz/IXAebSCYIM8elCIoHWUkeRv9JcUZXicNGIUoVRZqKZ0U
ESroEnsqORGrKpIPoyr2DWUqZwz2KekKXCl9CZ4oKAjAJ+oGyCbHBbwlwAShJNUDeyMIA04iWAIgIcMB8R9KAcUe6QCfHZ4AgRxmAGwbPgBhGiMAYhkRAGwYBwCBFwIA
FQDKK1IAuisXAYErNgInK6ADripIBRcqJgdkKTEJlihjC68nsg2wJhgQmiWPEnEkDxU0I5AX5iEMGokgeBwfH9EeqR0RISkcKiOhGh8lFBniJoIXdCjvFdIpXBTyKsoS
2ys9EYostQ8ALTYOOy3CDEEtWgsVLQEKvCy6CDsshgeVK2cGzypgBe8pcAT4KJoD7yfeAtgmPAK4JbIBkiRAAWsj5ABEIp0AIiFmAAMgPwDuHiQA4B0SAN8cCADsGwIA
FgB9KFUAbSgiATYoSgLfJ7wDaidtBdkmUwcuJmYJaiWeC44k9A2cI2IQliLfEn4hZhVUIPAXGx90GtQd7hyCHFofJhutIcEZ4iNWGPcl5xbgJ3UVnikCFCwrkBKELCER
qS23D5guUw5ML/cMyi+mCxUwYQovMCkJGjACCNYv7AZpL+kF2C77BCcuIgRbLV8DeCyzAoErHgJ7Kp8Bayk1AVMo3gA2J5oAGCZmAPkkQADdIyUAxSITALEhCACnIAIA
FwB9JVkAbiUuATglYALjJN0DcySZBegjiwdDI6gJiCLsC7chSw7RIMEQ2R9IE9Ae2RW4HW4YkhwAG2Abix0jGgkg3hhvIpMXvyRCFvEm7hT9KJgT4ypDEp0s7xAnLp8P
hC9UDqowEA2cMdQLXDKiCusyewlFM2EIbTNWB2kzWwY7M3EF5jKaBG4y1QPXMSQDIzGIAlYw/wF0L4oBgS4nAYIt1wB2LJYAZCtlAE0qQAA1KSUAICgUAAonCQD1JQIA
GADEIl0AtSI8AYAieQIuIgMEwSHNBTshzAeeIPkJ6h9IDCMftg5IHjoRXR3NE2IcaxZZGw4ZRBqwGyUZTB79F9sgzRZYI5gVwSVfFA4oJBM7KugRRiyuECkudQ/iL0EO
cDERDcsy6Qv4M8kK9jSzCcA1qAhZNqkHxDa3BgI31AUWNwEF/zY+BMA2jANfNusC3TVdAj414AGINHQBvDMZAd0yzgDtMZIA8zBjAPAvPwDlLiUA2C0UAMosCQC9KwMA
GgBLIGIAPSBLAQkglQK5Hy4ETx8IBs4eFwg2HlMKih20DMscMQ/7G8URGxtqFC0aGhczGc0ZLhiBHCAXLh8KFtEh7hRmJM0T6CaqElAphhGdK2EQyy0+D9QvHg64MQIN
czPtCwE13gpmNtcJmzfZCKA45gd4Of8GJTokBqE6VwXyOpcEGTvnAxg7RQPzOrQCrDoyAkY6wAHDOV4BJTkKAW44xQClN4wAyzZgAOQ1PgDwNCUA9DMUAPEyCQDfMQMA
GwAOHmcA/x1aAcwdswJ+HVwEFx1HBpocaggHHLkKYhssDasavg/kGWUSDxkbFS0Y3RdAF6UaSRZtHUsVMCBFFOoiOxOXJS4SMygeEbYqDhAjLf4Oci/xDaEx5wyuM+IL
kzXjClI36gnpOPoIUjoTCJI7NgenPGMGjT2dBUc+4gTXPjUEQD+VA4A/AwOYP38Ciz8JAlw/ogEPP0gBpT77AB8+uwCDPYYA0zxdABA8PQA7OyUAWDoUAGw5CQCCOAMA
HAAFHG0A9htrAcQb0wJ3G44EExuOBpkaxAgMGigLbRmyDb0YWBD/FxUTMxfkFVwWuxh7FZkbkhR3HqETUSGrEiQksRHrJrUQoCm3D0EsuQ7NLr0NPTHDDI8zzgvENd0K
0jfyCb85DgmFOzIIIj1eB5k+lQbjP9UFBEEgBfxBdwTMQtoDcUNJA+1DxQJERE0Cd0TiAYZEhAF2RDEBR0TrAPhDsACPQ4AADkNZAHdCOwDKQSQADkEUAERACQBqPwMA
HgAtGnMAHhp+AewZ9gKhGcUEPxnZBskYJwlAGKELphdCDvwWARFGFtcTgxW8FrYUrRngE6UcAxOdHx8SkSI3EX0lTBBdKF8PLityDu4thQ2ZMJoMKjOyC6A1zgr7N/AJ
MjoXCUs8Rgg8PnwHDEC6BrVBAgY0Q1MFj0SvBMNFFQTLRoYDrUcDA2pIiwICSR4Cc0m9AcBJZwHqSRwB9kncAOFJpgCxSXkAZ0lVAANJOQCHSCMA+UcUAFpHCQChRgMA
HwCAGHgAchiRAUAYGwP2F/4ElhcoByIXjgmdFiMMCBbeDmUVtxG1FKcU+xOpFzcTsxprEsUdmBHYIMEQ5yPmD/AmCA/uKSkO3ixLDb0vbQyIMpILOTW7CtM35wlTOhkJ
sjxRCPQ+kAcSQdYGEUMlBulEfAWeRt0EL0hHBJdJuwPbSjkD/EvBAvRMVQLITfIBd06aAQRPTAFvTwcBu0/NAOVPmwDwT3IA4U9QALVPNgBwTyIAF08TAKlOCQArTgMA
IQD7Fn8A7RalAbwWQgNyFjoFFBZ9B6MV/AkhFawMkRSDD/MTeBJKE4YVlhKjGNsRzRsYEfweTxAsIoMPWSWzDn8o4g2cKxANqy4/DKoxcAuUNKMKaTfaCSc6FgnLPFYI
UD+eB7xB6wYFREAGMEadBThIAwUgSnEE4kvoA4FNaAP/TvICVlCGAopRIgKaUskBi1N5AVRUMgH/VPQAhlW+APBVkQA5VmsAaVZMAHtWMwBwViEAT1YTABpWCQDIVQMA
IwCbFYUAjBW5AVsVaQMSFXkFtRTXB0YUcQrIEz4NOxMxEKISRhP/EXEWUhGuGZ4Q9hzjD0QgJA+VI2IO4iadDSkq1wxlLREMlDBMC7QziQrANsoJtzkOCZk8WAhiP6YH
DkL7BqFEVgYVR7gFa0kiBaFLlAS4TQ8ErE+RA4JRHQMxU7ECwFROAjBW9AF6V6MBo1haAaxZGQGUWuEAXluwAAZchwCSXGQA/FxIAE9dMQCEXR8AoV0SAKVdCQCJXQMA
JQBaFIwASxTPARoUkwPSE7wFdhMyCAkT6gqNEtUNBBLqEHARHBTREGkXKxDGGn4PMR7LDp8hFA4QJVsNfiigDOcr5AtFLykLljJwCtg1uQkHOQUJIzxWCCg/qwcXQgYH
6kRnBqRHzgVBSj0FwUyzBCVPMARnUbUDjVNDA5FV2AJ2V3YCPFkcAt5aygFiXIABx109AQtfAwEwYM8ANGGjAB1ifQDlYl0AlWNDACRkLgCbZB4A9WQSADplCQBoZQMA
JwA3E5MAKBPmAfcSvwOvEgAGVBKTCOkRaQtvEXMO6RCoEVgQ/hS/D2wYHg/tG3cOeB/MDQwjHA2fJmsMMCq5C7otBws8MVYKsDSnCRU4+whoO1IIqD6uB9NBDgfnRHQG
4EfhBcBKUwWHTc0EL1BNBL5S1QMtVWQDgVf7ArRZmQLMW0ACwl3tAZlfowFVYV8B8WIjAWtk7gDLZb8AD2eWADJodAA7aVYAJWo/APdqKwCsaxwASGwRAMxsCQA5bQMA
KQAuEpoAHxL9Ae0R7QOmEUcGTBH5COIQ7QtqEBkP5w9wEloP5xXFDnoZKQ4eHYgNzyDjDIUkOww9KJEL9CvnCqIvPgpHM5YJ4DbwCGo6TgjiPa8HR0EVB5dEgAbPR/AF
7kpnBfZN4wTlUGcEt1PxA25WggMJWRoDh1u6AuldYAItYA4CVGLDAWBkfwFMZkEBHGgKAdBp2gBna68A4myKAD9uawCDb1AArXA6ALpxKQCvchsAinMQAE10CADydAMA
KwA9EaIALhEWAvwQGwS1EJEGWxBfCfIPdAx8D8IP/A49E3IO2xbgDZEaSQ1bHq0MMSIODA4mbQvrKcoKxi0oCpwxhglnNecIJTlKCNQ8sQdxQBsH+0OKBnBH/gXNSngF
E074BEJRfgRXVAoEUFedAzBaNwP1XNcCnV9/AitiLQKcZOEB82acAStpXgFJayYBS230ADBvyAD8cKEArnJ/AEN0YwC+dUoAIHc2AGp4JgCaeRkAsnoPALJ7CACXfAMA
LQBiEKkAUhAuAiAQSwTZD90Gfw/KCRcPAQ2jDnMQJA4RFJ4N1BcQDbMbfQyiH+YLoCNMC6InsAqoKxQKqS95CaQz3wiVN0cIejuyB08/IQcSQ5QGwkYMBlxKiQXgTQsF
TVGTBKFUIQTdV7YD/lpRAwRe8gLyYJoCw2NIAnpm/QEVabgBlmt5AfttQAFHcA0BdnLfAI10twCKdpQAbHh1ADV6WwDme0UAfn0yAP5+IwBngBcAt4EOAPKCCAAahAMA
LwCaD7EAiw9HAlgPfAQQDyoHtw45ClAOkg3cDSgRYA3tFNsM1xhRDNscwQv0IC8LGCWaCkQpBApwLW4JmjHZCL01RgjVObUH3z0oB9tBngbERRkGmkmZBVtNHQUFUacE
l1Q4BBFYzgNyW2oDuV4MA+ZhtAL5ZGMC82cXAtBq0gGUbZMBPXBZAc1yJQFCdfYAn3fMAOF5pwAKfIcAHH5rABSAUwD0gT8AvYMvAHCFIQAMhxYAk4gNAAOKBwBpiwMA
MQDlDrkA1A5hAqEOsARZDnoHAA6pCpkNJg4nDeERrAzNFSoM3hmiCw0eFgtMIocKmyb3Ce8qZglFL9YIljNHCOE3ugciPDAHVECpBnZEJwaGSKkFgkwvBWhQuwQ4VE0E
71fkA49bgQMVXyQDgmLNAtNlewILaTACKmzrAS1vqwEXcnAB53Q8AZ13DAE6euEAvXy7ACh/mQB8gXwAtoNjANmFTQDnhzoA3YkrAL6LHgCJjRQAPY8NAOCQBwBtkgMA
MwA/DsEALg58AvoN5ASxDc0HWA0cC/IMvg6ADKASBwyzFocL7RoBC0MfeQqvI+4JJihiCaQs1QgjMUoInzXBBxI6Ogd6PrYG1kI1Bh9HuQVVS0IFd0/PBINTYgR4V/oD
VVuYAxlfOwPDYuQCU2aTAslpSAIkbQICZnDCAY5zhwGadlEBjnkhAWd89QApf84A0YGrAGGEjADZhnIAOolaAISLRgC3jTYA1Y8oAN6RHADRkxMAsZUMAH2XBgAymQMA
NQCnDcoAlg2YAmINGAUYDSEIvwyTC1gMWg/oC2ITcAueF/EKAhxuCoMg6AkXJWEJuinYCGIuUAgLM8oHsDdGB048xAbeQEUGYEXLBdJJVQUwTuQEeFJ3BKlWEATDWq4D
xF5SA6ti/AJ4ZqoCK2pfAsNtGQJAcdgBpHSdAe13ZgEbezUBMH4IASuB4AAMhLwA1oadAIeJgAAhjGgAoo5TAA6RQQBlkzEApZUlANCXGgDnmRIA6psLANudBgCznwMA
OAAdDdMADA20AtYMTgWMDHYIMgwNDMwL+A9cCygU5AqNGGcKGx3nCcchYwmJJt8IVStaCCgw1gf8NFQHyznUBpE+WAZMQ98F9UdqBY5M+QQSUY0EgVUnBNdZxQMVXmkD
OWITA0RmwQIzanYCCG4vAsFx7gFfdbIB4Xh7AUl8SQGWfxsByYLyAOKFzQDjiKwAyYuPAJiOdgBOkV8A7pNMAHeWOwDpmC0AR5siAI+dGADEnxAA5aEKAPOjBgDqpQIA
OgCeDNsAjQzQAlYMhgUMDM0IsQuHDEsLmRDbCvMUZAqDGekJPB5qCRIj6Qj+J2cI9yzmB/YxZQf0NucG7jtsBt1A9AXARYAFlEoQBVJPpQT9Uz4EkFjdAwxdgQNuYSoD
tGXYAuBpjALwbUUC5XEEAr51xwF6eY8BGX1cAZ6ALgEIhAQBWIfeAIuKvACmjZ4Ap5CDAI+TbABfllcAGJlGALmbNgBFnioAuqAfABqjFgBnpQ8An6cKAMWpBQDTqwIA
PAAqDOUAGAztAuELvwWWCycJOgsEDdQKPxFkCsAV7gl6GnQJXh/3CGIkeAh7KfkHni56B8kz/gbzOIMGFj4MBjFDmAU8SCkFNk29BB5SVwTtVvUDpluZA0VgQgPKZPAC
MmmjAn9tWwKucRkCwXXcAbd5owGQfW8BS4FAAeuEFQFviO4A14vLACSPrABVkpEAbZV4AGuYYwBQm1AAHp5AANSgMgByoyYA+6UcAG6oFADMqg4AF60JAE6vBQBtsQIA
"""
TABLE: Final[U32] = np.frombuffer(base64.b64decode("".join(_CODE.split())), "<u4").astype(np.uint32)
"""uint32[NODES · NODES]: row by row of roughness, in it by the root of the cosine, both from 0 to 1. 65535 (1 - E), and 65535 B in the upper half."""


def _averages() -> F64:
    # Of E as it is read between nodes, linear in v = the root of the cosine: the integral of 4 v^3 times the two hats of a cell.
    weights = [0.0] * NODES
    step = 1.0 / (NODES - 1)
    for node in range(NODES - 1):
        a, b = node * step, (node + 1) * step
        whole = b * b * b * b - a * a * a * a
        upper = ((0.8 * (b * b * b * b * b - a * a * a * a * a)) - a * whole) / step
        weights[node] += whole - upper
        weights[node + 1] += upper
    rows = []
    for row in TABLE.reshape(NODES, NODES).tolist():
        missing = grazing = 0.0
        for code, weight in zip(row, weights, strict=True):
            missing += weight * (code & 0xFFFF) / 65535.0
            grazing += weight * (code >> 16) / 65535.0
        rows.append((missing, grazing))
    return np.array(rows)


AVERAGES: Final[F64] = _averages()
"""float64[NODES, 2] by roughness: cosine-weighted means of 1 - E and of B over all directions."""


class Albedo(NamedTuple):
    """Of GGX with a Fresnel term of 1, and of (1 - V.H)^5."""

    missing: F64
    """1 - E: what a single bounce loses."""
    grazing: F64
    """B"""


def _between(nodes: F64, place: F64) -> tuple[F64, F64, F64]:
    at = np.clip(place, 0.0, 1.0) * (NODES - 1)
    low = np.minimum(np.floor(at), NODES - 2)
    part = (at - low)[..., None]
    row = low.astype(np.int64)
    return nodes[row], nodes[row + 1], part


def albedo(roughness: F64 | float, cosine: F64 | float) -> Albedo:
    """Of this roughness towards these cosines, f64[...], broadcast together; read from the table, linear between its nodes."""
    roughness, cosine = np.broadcast_arrays(np.asarray(roughness, np.float64), np.asarray(cosine, np.float64))
    both = np.stack([(TABLE & np.uint32(0xFFFF)) / 65535.0, (TABLE >> np.uint32(16)) / 65535.0], axis=-1).reshape(NODES, NODES, 2)
    low, high, part = _between(both, np.maximum(roughness, ALPHA_MIN**0.5))
    rows = low * (1.0 - part[..., None]) + high * part[..., None]
    at = np.sqrt(np.clip(cosine, 0.0, 1.0)) * (NODES - 1)
    left = np.minimum(np.floor(at), NODES - 2).astype(np.int64)[..., None, None]
    found_low, found_high = (np.take_along_axis(rows, left + more, axis=-2)[..., 0, :] for more in (0, 1))
    share = (at - left[..., 0, 0])[..., None]
    found = found_low * (1.0 - share) + found_high * share
    return Albedo(found[..., 0], found[..., 1])


def mean_albedo(roughness: F64 | float) -> Albedo:
    """Cosine-weighted means of `albedo` over all directions."""
    low, high, part = _between(AVERAGES, np.maximum(np.asarray(roughness, np.float64), ALPHA_MIN**0.5))
    found = low * (1.0 - part) + high * part
    return Albedo(found[..., 0], found[..., 1])


def bounced(f0: F64 | float, f90: F64 | float, missing_mean: F64 | float) -> F64:
    """Of the light that a single bounce loses, the share that comes out after more of them, by Schlick's term.

    Favg² Eavg / (1 - Favg (1 - Eavg)), Favg = f0 + (f90 - f0) / 21; 1 where f0 = f90 = 1.
    """
    mean = np.asarray(f0) + (np.asarray(f90) - np.asarray(f0)) / 21.0
    result: F64 = mean * mean * (1.0 - np.asarray(missing_mean)) / (1.0 - mean * np.asarray(missing_mean))
    return result


def left_of(f0: F64 | float, at: Albedo, mean: Albedo) -> F64:
    """What a dielectric layer does not give back, with `at` of a direction; f90 = 1. f64[..., 1]."""
    missing, grazing = at.missing[..., None], at.grazing[..., None]
    result: F64 = 1.0 - f0 * (1.0 - missing - grazing) - grazing - bounced(f0, 1.0, mean.missing[..., None]) * missing
    return result


def beside_one_bounce(base: F64, metallic: F64 | float, roughness: F64 | float, f0: F64 | float, o: F64, i: F64) -> F64:
    """glTF's surface, f64[..., 3] without cosine, but for the single bounce on its microfacets: further bounces, and the body.

    base f64[..., 3]; metallic and f0 f64[..., 1]; roughness and the cosines o, i f64[...] (specs/09-renderer-contract.md).
    """
    at_o, at_i, mean = albedo(roughness, o), albedo(roughness, i), mean_albedo(roughness)
    more = (at_o.missing * at_i.missing / (np.pi * np.maximum(mean.missing, 1e-9)))[..., None]
    body = base * (left_of(f0, at_o, mean) * left_of(f0, at_i, mean) / (np.pi * left_of(f0, mean, mean)))
    missing = mean.missing[..., None]
    dielectric, metal = body + bounced(f0, 1.0, missing) * more, bounced(base, 1.0, missing) * more
    result: F64 = (1.0 - np.asarray(metallic)) * dielectric + metallic * metal
    return result
