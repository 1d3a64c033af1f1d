"""What a rough boundary of glass gives on of even light, mirrored and bent together: a table, made once by tools/make_glass_albedo.py.

Of Walter's rough dielectric with Smith's height-correlated term (refraction_kernels.py), one bounce; the rest is what facets hide, and
send on after several bounces (specs/09-renderer-contract.md, *Glass*). Whole numbers, so that all nodes read the same.
"""

from __future__ import annotations

import base64
from typing import Final

import numpy as np

from scenefold.render.arrays import F64, U32
from scenefold.render.ggx_albedo import ALPHA_MIN

ROUGHNESSES: Final = 24
COSINES: Final = 24
INDICES: Final = 16

_CODE = """
9frQ9dr6KPnS+gH6z/pN+s76dfrN+o/6zfqg+sz6rPrM+rb6zPq9+s36wfrO+sX6z/rH+tL6yPrb+sn62PzJ+nPrjefN6XjoX+mz6DrpyOgo6dPoHuna6Bnp3ugW6eLoFenl6Bfp
5ugb6ejoJOnp6DXp6ehY6enowunq6D/y6uhB/vv8s/03/Yb9Rv13/Uv9b/1O/Wv9UP1p/VH9Z/1S/Wf9U/1o/VP9av1U/W39VP10/VT9gv1U/ar9VP3U/VT9yP9Z/6X/df+W/3z/
kP9+/43/f/+L/4D/i/+B/4r/gf+K/4H/iv+C/4v/gv+M/4L/j/+C/5T/gv+g/4L/jv+C//H/vf/p/9L/4//W/+D/1//f/9j/3v/Y/97/2P/d/9n/3f/Z/93/2f/e/9n/3v/Z/9//
2f/i/9n/5v/Z/9v/2f/5/8n/+P/r//X/7v/0/+7/8//v//P/7//y/+//8v/v//L/7//y//D/8v/w//P/8P/z//D/9P/w//b/8P/w//D//P/1//z/9P/7//b/+v/3//r/9//6//f/
+f/3//n/9//5//j/+f/4//n/+P/6//j/+v/4//r/+P/7//j/+P/4//3/+//+//j//f/6//3/+v/9//v//P/7//z/+//8//v//P/7//z/+//8//v//P/7//z/+//9//v//f/7//v/
+//+//3//v/6//7//P/+//z//v/8//7//P/+//3//v/9//3//f/9//3//v/9//7//f/+//3//v/9//7//f/9//3//v/+//7//P/+//3//v/9//7//f/+//3//v/9//7//f/+//3/
/v/9//7//v/+//7//v/+//7//v/+//7//v/+/////v////7////9/////v////7////+/////v/+//7//v/+//7//v/+//7//v/+//7//v////7//v/+//7//v/////////+////
/v////7////+/////v////7////+/////v////7////+/////v////7////+/////v/+//7///////////////3////+/////v////7////+/////v////7////+////////////
///////////////////////////////////+/////v////7///////////////////////////////////////////////////////////////////////////////7/////////
////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////
////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////
//////////////////////////////////////////////////////////////////////7/////////////////////////////////////////////////////////////////
////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////
//////////////////////////////////////////////////////////////////////7/////////////////////////////////////////////////////////////////
////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////
////////Sf1U80D99vk5/ab7Nv07/DX9i/w0/bz8NP3f/DT9+Pw0/Qv9NP0Y/TT9Iv01/Sn9Nv0t/Tn9L/1B/TD9T/4w/cbnBeCa5fTiAuWx48/k8+O25BbkqOQs5KDkO+Sc5EXk
m+RO5J7kU+Sk5FjksORb5MfkXOT45F7kiuVe5PvuXuQN+qj1LfiD9pb3ufZi98z2SPfX9jr33fYy9+H2Lffl9i335/Yv9+n2Nffq9kH36/ZY9+v2iPfs9g347Pae+Oz2Lf+M/aj+
9f1u/g3+WP4V/k3+Gv5H/h3+Q/4f/kH+IP5B/iH+Qv4i/kT+I/5J/iP+U/4j/mX+I/6T/iP+Uv4j/s3/BP+t/1f/lv9k/4z/af+G/2z/g/9t/4H/bv+A/2//gP9w/4D/cP+C/3D/
hP9x/4j/cf+Q/3H/oP9x/3n/cf/r/0H/5f+2/9v/v//W/8L/0//E/9L/xf/R/8X/0P/G/9D/xv/Q/8b/0f/H/9L/x//U/8f/1//H/97/x//J/8f/9P/c//X/2P/x/9//7v/h/+3/
4v/s/+P/6//j/+v/5P/q/+T/6v/k/+v/5P/r/+T/7P/k/+7/5P/w/+X/5f/l//n/8P/6/+f/+f/t//f/7//2/+//9v/w//X/8P/1//D/9f/x//X/8f/1//H/9f/x//b/8f/3//H/
+P/x//H/8f/7//n//P/r//z/9P/7//X/+v/2//r/9v/6//b/+v/2//r/9v/6//f/+v/3//r/9//6//f/+v/3//v/9//3//f//f/8//3/8//9//f//f/4//3/+f/8//n//P/5//z/
+v/8//r//P/6//z/+v/8//r//P/6//z/+v/8//r/+v/6//3//f/+//r//v/5//7/+v/+//v//f/7//3/+//9//v//f/7//3/+//9//z//f/8//3//P/9//z//f/8//z//P/+//7/
/v/8//7/+v/+//z//v/8//7//P/+//z//v/8//7//f/+//3//v/9//7//f/+//3//v/9//7//f/9//3//v/+//7//f/+//f//v/8//7//f/+//3//v/9//7//f/+//3//v/9//7/
/f/+//3//v/9//7//f/+//3//f/9//7//v////7////9/////f////3////9/////v////7////+//7//v/+//7//v/+//7//v/+//7//v/+//7//v/////////+/////v////3/
///+/////v////7////+/////v////7////+/////v////7////+//7//v/+//7///////////////7////9/////v////7////+/////v////7////+/////v////7////+////
/v////7//v/+///////////////+/////v////7////+/////v////7////+/////v////7////+/////v////7////+//7//v////////////////////7////+/////v////7/
///+/////v////7////+/////v////7////+/////v/+//7//////////////////////////v////3////+////////////////////////////////////////////////////
///////////////////////////+/////v////7////////////////////////////////////////////////////////////////////////////////////+////////////
//////////////////////////////////////////////////////////////////////////////3/////////////////////////////////////////////////////////
////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////////
////////////////wf7F1kb/4PFN/934Tf9N+0z/mPxM/2f9TP/3/Uz/X/5M/6v+TP/k/kz/Df9N/yn/Tv86/1H/RP9X/0j/fv9J//vz+NLN9CvpdPTA7kr0svA09LfxJ/Rd8iD0
z/Ic9CHzG/Re8x70i/Mk9KrzMfTB80j0zvN39Nbz+/TZ8yr32vMP7QzSsuim3sPmp+EM5rDisOU7433lkuNf5c7jT+X640zlGuRU5TLka+VC5JblTuTo5VXkkOZZ5FfoW+Qp6Vvk
jfbK4Z7xLuk677XqT+4769jtgeuU7a3rbO3M61jt4utS7fLrXO3+63ntB+yv7QzsFO4Q7NzuEuzK8BPs/u0T7MX85+65+j31O/ki9pj4bvZC+Jb2EPiw9vL3wfbi98723vfX9uT3
3fb49+L2Hfjl9mH46Pbg+On28fnp9nD36fau/kb3MP7y+nv9kPsf/cH77Pza+8786vu7/PX7sfz9+638A/yx/Af8vPwK/NH8DPz1/A38Nv0O/Kr9Dvw1/A78Vf+l/Un/SP3+/sr9
zf7t/bD+/v2e/gn+kv4Q/oz+Fv6J/hr+i/4c/pD+Hv6c/iD+r/4h/s7+If76/iH+Lv4h/p//D/+o/z/+jf/D/nT/3v5j/+v+WP/z/lH/+P5M//z+Sv///kv/Af9O/wL/VP8D/17/
BP9s/wT/e/8E/wn/BP/F/5z/zv9V/sb/O/+6/1L/sP9c/6n/Yv+l/2b/ov9p/6H/a/+h/23/ov9u/6X/bv+q/2//sP9v/7T/b/9x/2//2v/M/+D/P//f/3r/2v+P/9X/l//Q/5z/
zf+g/8v/ov/K/6P/yv+l/8v/pf/M/6b/z/+m/9H/pv/Q/6b/qP+m/+f/4f/q/6//6/+b/+n/sf/n/7n/5P+9/+L/wP/h/8L/4P/D/+D/xP/g/8T/4f/F/+H/xf/i/8X/3//F/8b/
xf/u/+z/8P/R//L/p//x/8b/8P/N/+//0f/t/9P/7f/V/+z/1v/s/9b/7P/X/+z/1//s/9f/7P/X/+n/1//Y/9f/9P/y//X/4//2/4X/9v/S//X/2v/1/93/9P/f//P/4f/z/+H/
8//i//L/4v/y/+P/8v/j//H/4//v/+P/4//j//f/9v/3/+//+P/c//n/2f/4/+L/+P/l//j/5//3/+j/9//p//f/6f/2/+r/9v/q//b/6v/1/+r/8v/q/+r/6v/5//n/+f/1//r/
6//6/83/+v/n//r/6//6/+3/+v/u//n/7v/5/+//+f/v//n/7//4/+//9//v//X/7//v/+//+//7//v/+f/7//L//P/j//z/6//8/+7/+//w//v/8f/7//L/+//y//v/8v/6//L/
+v/z//n/8//3//P/8//z//z//P/8//v//P/2//z/8f/8/+L//P/x//z/8//8//T//P/0//z/9f/8//X/+//1//v/9f/6//X/+f/1//X/9f/9//3//f/8//3/+f/9//b//f/v//3/
8f/9//T//f/1//3/9v/9//b//P/3//z/9//8//f/+//3//r/9//3//f//f/9//3//f/+//v//v/5//7/9//+/+H//v/1//3/9//9//f//f/4//3/+P/9//j//P/4//z/+P/6//j/
+P/4//7//v/+//7//v/9//7/+v/+//n//v/3//7/6v/+//f//v/4//7/+P/9//n//f/5//3/+f/8//n/+//5//n/+f/+//7//v/+//7//v/+//z//v/7//7/+v/+//f//v/z//7/
+P/+//n//v/6//3/+v/9//r//P/6//z/+v/6//r//////////v////7////9/////P/+//v//v/6//7/+f/+/+T//v/5//7/+v/+//r//f/7//3/+//8//v/+//7////////////
///+/////v////3////8////+//+//v//v/6//7/+f/+//f//v/6//3/+//9//v//P/7//v/+/////////////////////7////+/////f////z////8//7//P/+//z//v/8//7/
/P/+//z//f/8//3//P/8//z/+P1fqIb/eeGo/yPxrf+q9q//k/mv/2v7r/+w/LD/m/2w/0r+sP/K/rH/Jv+x/2X/sv+N/7T/o/+5/6z/vv+t/1fxxan3+cbegvoV7YP6FfJ8+rb0
dvph9nL6hfdx+lr4cfr1+HT6avl6+rv5hvr1+Zn6GPrA+iz6Ifs0+lH7Nfr+6Hmupu9u2PLuKuNt7trmIO7I6PLt/enX7dPqye1v68bt4OvO7TPs5e1u7BDul+xg7rHs/O6/7IHw
xex278XsUuyYuP/rH9cr6S3e3eeL4Crnx+HB5ozig+YT42PmduNa5r3jauby45bmGOTq5jHkhedB5LHoSuRz603k0eZO5ED0fMmt8WPfJO4F5H3sheWX60rmEOvG5r/qG+eU6ljn
h+qE55nqpufN6rznM+vM5+nr1uc87dvnB/Dd50Dp3ufi+d7ihfhS6uX1tO2B9LTuuPM27z7zh+/08r7vy/Lm777yA/DL8hnw9vIo8ErzMvDd8zjw3vQ78K32PfDX8D3wuPys9HX8
MPIL+xT1IfrN9ZL5KPY5+WH2AfmH9uL4ovbW+Lb23fjF9vr4z/Yx+db2j/na9if63fYF+932Hffd9h7+fvs4/mn2nf1u+Rf9Avq9/Ef6gvxv+lv8i/pF/J/6O/yt+j78uPpO/L/6
b/zE+qT8x/ry/Mj6Rv3J+uT6yfra/hb+//4D+Mr+1PuE/lP8T/6J/Cn+qfwQ/r/8AP7O/Pn92Pz5/eD8Af7l/BP+6fwu/uv8Uv7s/Gf+7Pz4/Oz8Rf8A/1//QvxU/yH9M/+c/RX/
y/3+/uT97f71/eL+Af7d/gn+3P4P/t/+E/7o/hb+9f4X/gP/GP7+/hj+Hv4Y/oT/af+U/1r+l//P/Yr/Wv56/4T+bP+Z/mH/p/5a/7H+Vf+3/lT/u/5V/7/+WP/B/l7/wv5h/8L+
U//C/sb+wv6s/6D/tf8P/7v/+P23/8n+r//z/qf/Bv+g/xL/m/8a/5f/H/+W/yL/lf8l/5b/Jv+X/yf/lf8n/4b/KP8q/yj/xf+//8r/cf/Q/wL+z/8L/8z/OP/H/0r/w/9V/8D/
W/+9/1//vP9i/7v/ZP+6/2X/uf9m/7X/Zv+m/2b/Z/9m/9b/0//Z/7D/3f9I/97/KP/d/2P/2v92/9j/gP/W/4X/1P+J/9L/jP/R/43/z/+O/83/jv/I/4//u/+P/5D/j//i/+D/
4//P/+b/l//n/9z+5/9+/+b/k//k/53/4/+i/+H/pf/g/6f/3/+o/93/qf/a/6r/1f+q/8r/qv+r/6r/6v/p/+v/4P/s/7r/7f9x/+7/if/t/6b/7P+w/+v/tf/q/7n/6f+6/+j/
u//m/7z/4/+8/97/vP/U/73/vf+9//D/7//w/+r/8f/P//L/uf/y/07/8v+x//H/vf/x/8P/8P/G/+//x//t/8j/7P/J/+n/yf/k/8r/3P/K/8r/yv/0//T/9P/x//X/4f/1/9H/
9f+q//X/sf/1/8b/9P/M//T/z//z/9H/8f/S//D/0v/t/9P/6f/T/+L/0//T/9P/9//3//f/9f/4/+z/+P/f//j/0//4/3j/9//I//f/0v/2/9b/9f/X//T/2f/y/9n/8P/a/+z/
2v/m/9r/2//a//r/+f/6//j/+v/z//r/5//6/+H/+v/U//n/kP/5/9T/+P/Z//f/3P/2/93/9f/e//L/3//v/+D/6f/g/+D/4P/7//v/+//7//v/+P/7//D/+//p//v/5P/7/9f/
+v+v//r/2v/5/9//+P/h//b/4v/0/+P/8f/j/+z/5P/k/+T//f/9//3//P/9//r//f/2//z/7//8/+r//P/m//v/3v/7/5//+v/e//n/4//3/+X/9f/m//L/5//u/+f/5//n//7/
/v/+//7//v/8//7/+f/9//T//f/u//3/6//8/+j//P/l//v/3//6/9D/+P/k//b/5//z/+n/7//p/+n/6f///////////////f////v//v/4//7/8v/9/+3//f/r//z/6//7/+v/
+v/r//n/6//3/+v/9P/r//H/6v/r/+v/jvwzdXH/2Mq9/wLmyv/H787/9fTQ/zr40f99+tH/IfzS/1b90v87/tP/3v7U/0//1f+W/9b/vv/a/83/1//Q/zfoc3hd+knKaPw65LX8
fu3J/GXy0PyA9dL8offV/C751/xR+tz8KPvi/MH77Pwq/P78bfwd/ZL8Yv2h/Bv9o/wb21yCa/LWyMv0Od/m9BTn0vQ26730zO2v9JXvqfTf8Kr00fG09IPyyfQC8+/0WfMz9ZDz
sPWt88j2ufMQ9bvzst3OkkXtSsiQ7fvZ2OwA4FTsIOP/6xTlyuts5q7rY+en6xbot+ub6OLr+eg07Dnpxexi6dPteOkc8IDpReuB6Qbnlaye7bvLiusb2enpct3q6LDfTegQ4e3n
AuK457Diqecu477ni+P+583jeej541PpFeTg6iTk+O0p5K7lKuQ88B3MOvKp0z7vJ94y7Uvh9eve4i/r1uO16n/kcer55FrqUeVv6pHltuq+5UHr3eUy7O/l0+355avw/eX45v3l
lfb05FT3Dt3n9CLmEPOC6OTxp+kl8VrqrPDT6mfwKetN8GjrXfCW65rwtesT8cvr3/HX6ynz3usD9eDra+zh61b6sPPe+tjkevmW7Sn4hO9A92bwpfbs8EH2RfEF9oTx7PWy8fT1
0/Ef9urxdfb58QL3AvLT9wfysvgI8lDyCPJ8/FH65vzn6078FPOB+8j05PqA9XT66fUp+iz2+vlc9uT5f/bm+Zf2//mo9jT6tPaH+rr29vq99jX7vvbj9r72vf3y/Ab+OvXb/Z72
b/1O+A396vjD/D/5jvx2+Wz8nPla/Lf5V/zK+WT81/mA/N/5q/zk+dr85vnM/Ob5+vnn+X/+Lf6t/rP6rv6j+Hz+ivpF/hv7Fv5k+/P9kfva/a/7zP3F+8f91PvL/d772P3k++r9
6Pv3/en7yv3q+/T76vv5/tT+FP/8/CL/ZvkQ/+778v5+/Nb+wfy//uj8rv4B/aP+E/2e/h/9nf4n/aH+K/2l/i79n/4u/Wz+L/02/S/9Sf83/1j/Rf5m/+36Yv++/FT/Yv1E/6L9
Nv/E/Sr/2/0i/+n9HP/z/Rn/+f0Y//39FP/+/Qf///3W/gD+BP4A/n7/dP+G/wf/kv+v/ZP/Ff2N//L9hf81/nz/Vf50/2r+bv92/mn/fv5l/4P+YP+F/ln/h/5J/4j+Hv+J/ov+
if6i/53/p/9o/6//qv6y/8D8sP9I/qz/lf6n/7b+of/K/p3/1f6Y/9z+k//g/o7/4v6F/+P+df/k/lD/5f7n/uX+vP+5/7//nv/D/x//xv9E/sb/Zf7E/9T+wf/5/r7/C/+6/xX/
tv8c/7H/H/+r/yH/ov8i/5P/JP9z/yT/Jf8k/87/zf/Q/77/0/9l/9X/Gv/V//T91P/3/tP/Jf/Q/zn/zf9D/8r/SP/F/0v/v/9N/7b/T/+o/1D/jf9R/1L/Uf/c/9v/3f/S/97/
n//g/2v/4P/z/t//6v7e/0D/3P9X/9r/Yv/X/2f/0/9r/83/bf/E/3D/t/9x/6D/cf9y/3H/5v/m/+f/4P/n/8T/6P+W/+j/cP/n/57+5v9E/+X/av/j/3f/4P9+/9z/gv/X/4X/
z/+I/8L/if+u/4n/iv+J/+7/7f/u/+r/7v/a/+7/s//u/57/7f91/+3/z/7r/27/6f+E/+b/jf/j/5L/3f+W/9b/mf/L/5r/uf+b/5v/m//0//T/9P/x//T/6P/0/8//8/+4//L/
p//x/4D/8P8P/+7/hP/r/5f/6P+e/+P/o//c/6f/0v+o/8L/qP+p/6j/+P/4//j/9//4//H/+P/i//f/yv/2/73/9f+v//P/lv/x/xz/7/+Q/+v/pf/n/6z/4P+w/9f/sv/J/7P/
s/+z//z//P/8//v//P/3//v/7f/6/9z/+f/J//j/wP/2/7j/9P+v//L/mf/u/2n/6v+q/+T/tf/b/7n/zv+7/7v/u//////////+//7/+v/+//L//P/o//v/2v/6/8X/+P/D//b/
w//z/8L/8P/C/+z/wv/m/8L/3//B/9P/wP/C/8L/4vrBSjf/ja+5/9bX0f/c5tn/6+7c/wX03v+N9+D/Hfrg/wD84f9m/eL/Zf7i/xX/4/+G/+X/wv/o/9z/4//g/xvePVDA+Nqv
xPwX1379p+W6/XLt0/1f8t/9xvXo/T/47v0Q+vT9Zvv8/Vz8Bv4F/RX+b/0u/qr9X/7B/QH+xf0Gy0JhFvDYsN326NT59x7iQ/gd6Vr4iO1k+JHwavjB8nP4X/SB+I31lvhm9rn4
+vby+Fj3VPmK9xb6nvdX+KH3mMsCfPTqybLn8CzShPFc3X3xP+Nh8evmSvFv6T7xP+tB8ZLsU/GL7XzxPO7E8bTuPvIA7xXzKe+69DjvUvA679/VtpwL6ma2KO2d0LzspNko7Ere
uOst4W7rJONF643kO+uU5VLrVOaP693mA+w558rscucn7pDnp/Cb583onOcy4lK7vuxmvCvtMtLG60vZrerh3OzpDt9w6YrgKumb4RLpYOIq6e7ieOlU4w7ql+MQ68HjwuzW443v
3uPh5N7jZOzM1E7xqMRf8DDXg+7c3CTtnd827EnhnOtl4kLrMeMf68LjM+ss5ITrduQj7KfkLe3F5NXu1OQe8dnkkeXZ5G/za+jD9cDOtvQc3vby3uKh8Qrls/BT5hXwLee278fn
ju806Jrvg+jf77roaPDe6Ejx9OiS8v7o5vMC6XfpAuno96bzIvkB3IH4/+Qz90jpHPYU61L1GezH9MTscPQ87Uf0j+1J9MrtefT17dz0D+559R7uR/Ym7rj2KO5u7ijur/r8+GP7
Cuot+5rqXPrJ7pf5XvD++DXxj/jA8Uf4H/Ih+GDyHPiO8jf4rvJz+MLyz/jO8jP50vIR+dTy/fLU8m38svvW/Lvz3fyE7m/8+fLy+3H0iPst9Tf7oPX/+uz13voi9tT6Rvbe+l/2
+/pu9ib7dvZC+3n22fp79pP2e/aL/TX9yP3d+OX9SvG1/eH1bf1f9yn9C/jx/G74yPyv+K382/ig/Pj4n/wM+aj8F/my/B35pfwf+Sb8Ifkw+SH5R/4d/mv+6/uI/qL1ef6691T+
ZPkr/gz6Bv5n+un9nvrT/cP6xv3b+r/96/q6/fT6sv33+pH9+voV/fv6Bfv8+sb+sP7a/q398v5e+vL+pPjh/rz6yv5t+7L+w/ue/vb7jf4X/ID+K/x2/jf8a/49/Fj+QPwv/kP8
v/1F/Ev8Rfwe/xL/Kf+T/jr/qvw//zX5OP+N+yz/XPwe/7T8EP/l/AP/Av33/hT96/4d/d3+Iv3G/iX9m/4o/Tv+Kf0t/Sr9XP9V/2L/E/9t/9D9cv/w+3H/2Ptr//j8Yv9b/Vj/
jP1O/6b9RP+2/Tf/vf0o/8L9EP/G/ef+yf2U/sr9zf3K/Yn/hf+M/2D/k/+G/pf/wf2X/6z7lP9K/Y7/zP2H///9f/8b/nb/Kf5q/zD+W/80/kP/Of4d/zz+1/49/j/+Pf6q/6f/
rP+S/6//F/+y/4r+sv97/bD/NP2s/wv+p/9P/qH/bP6Y/3n+jf+B/n7/h/5n/43+RP+P/gj/kP6S/pH+wv/B/8P/tP/F/3D/xv/4/sb/mP7E/zD9wf8R/r3/ff63/6H+sP+y/qX/
vP6X/8T+gv/K/mL/zf4u/87+z/7O/tX/1P/W/8z/1v+l/9b/Rf/V/wz/1P+n/tH/j/3N/4D+yP/A/sD/2/62/+f+qf/x/pX/9/54//v+Sv/8/v3+/P7k/+P/5P/e/+T/xv/j/4v/
4f9O/9//If/c/8P+2f/4/dP/vP7M//D+w/8F/7b/E/+j/xr/if8d/2D/H/8f/x//7//v/+//6//u/9z/7f+5/+v/ff/p/1j/5v81/+L/9/7c/zr+1v/a/sz/E//A/yj/r/8z/5b/
OP9y/zr/Ov86//j/+P/4//X/9//r//X/0//z/6r/8P96/+3/X//p/0n/4/8x/9z//P7U/6r+yP8g/7f/P/+h/0v/gP9O/0//T//////////8//3/8v/7/+L/+f/I//X/o//y/3L/
7f9g/+j/YP/h/1//2P9e/83/Xf++/1z/qf9Y/4v/Vv9f/17/E/klLuj+D5Ko/wXHzf8Y3Nr/iOfg/93u5P/u8+X/nPfn/1T66P9W/On/xv3q/8T+6/9m/+z/vv/u/+L/6f/n/8XU
zTYg9sySW/zLxqD9cdsP/qbmQf7K7Vv+uvJr/lL2d/72+ID+6fqK/k/8lP5F/aL+4P23/jX+2f5X/n7+Xf5gvb1Q4eodlZP2LMYE+YrZ0fn64yb6mupR+i3vbPp68oH66/SV+rT2
rvr698/62/j/+mf5TPuz+dH70fk/+tX5irtOc47kzJg/8WbFzfPN1of0GuDH9PTl4vT36fP03OwF9fruIPWI8En1o/GJ9WPy7/Xd8pX2HfO19zXz5/M488vEApQ64/+dke0LxU7v
INSS7w7cie/+4HXvW+Rq78bmb++K6Izv0OnH77rqLPBY69Twuevo8ezrsvP+69jsAOw00kevl+X5pEzsD8bU7MzSd+xV2Q3sX9286xjgjesK4oHrcuOc63jk5+sv5XHsq+VX7fbl
zO4d5v7wK+YE5yzmKt/+xhHqXq6U7SbJEe3k0ynsOtlp63Xc4eqe3pDqJuBx6j/hiOoK4tzqmeJ86/fihuww4yHuTeMu8FbjD+RW43Tp0tsi72G7qPA5zpXvg9dh7uPbcO173sbs
M+Be7GbhMOxC4j/s3+KP7E7jLe2U4y3uvuOf79PjAPHZ42bk2uPB8GnqrfNrzE70cNQr88jc9PGD4P3woOJN8ALk3O/25KbvouWo7x3m6O9w5mvwp+Y68cbmRfLV5sLy2OY759nm
qvXN8jb3/NyS96jarfaP4qj12+XP9KjnLvTK6MPzjemK8xbqgfN36qnzuOoE9OHqjfT56iH1Auvc9AXrR+sG6+n4lvfD+QPqEfpR4IH52OfD+PPqGfiF7JX3fO049x7uAveO7vD2
2+4B9w/vMvcu73j3P++l90Xv5/ZI73PvSe8P+236i/uG8tP7RuaK+yPsD/s975b6svAy+onx6PkT8rf5cPKf+bDynfnY8q358fK/+fzypfkA87L4BPMg8wXzgvwv/Mn8FvgF/dTt
6fxB76P8kvJU/P7zDfzE9NT7PPWq+4z1kPvB9YL74vV6+/T1afv79Sb7APYt+gT2FvYF9n/9VP2o/V/71v3a9NP9XfGu/fz0fv169k79N/ck/ab3A/3s9+j8GPjT/DP4vPxA+Jf8
RvhB/Ez4WvtQ+Fz4UPgx/hn+SP4d/Wj+Fvlu/tzzXv6N9kP+Qvgk/gb5Bv5x+er9sPnR/db5uf3s+Zr99flr/f35EP0D+kT8BvoO+gb6r/6i/r3+HP7R/nP72f4e+NP+W/fE/nf5
sP5S+pv+vvqF/vv6bv4d+1X+Lvsz/jj7AP5A+6j9R/v3/Er7UPtK+wv/A/8T/7n+H//5/Cb/Svsk/zL4G/8k+g//OPv//q/77f7s+9n+Cvy//hv8nv4n/Gv+MPwY/jb8gf05/D38
OfxP/0r/U/8f/1r/I/5e/+b8Xf//+lj/PfpP/7/7Q/9U/DT/mPwi/7b8Cf/K/Oj+1vy4/uH8bP7o/Or96vzt/Or8gv9//4T/ZP+H/9j+if/U/Yf/Bf2D//j6fP/U+3L/tvxl/wr9
VP8z/T7/Sv0e/1r98f5m/av+bP07/m/9cf1v/aj/p/+p/5b/q/9E/6r/ff6o//r9pP8s/Z3/oPuU/8D8if9N/Xn/h/1j/6f9Rf+8/Rv/yv3c/tD9ev7T/dX90/3G/8X/x/+7/8b/
if/F/w//wf+I/r3/KP62/239rv9Q/KL/Rv2T/7T9f//p/WP/Bf47/xX+Av8c/qz+IP4h/iD+3v/d/97/1v/c/7b/2v9t/9b/7/7R/57+yv9S/sH/1f22/9r8p/+M/ZP/A/55/zT+
VP9L/h//V/7T/lv+Xf5c/vD/8P/w/+v/7v/V/+v/pf/m/07/4P/o/tn/rv7Q/3/+xP9M/rb/6v2j/4j9iv8i/mf/Zv43/3/+8v6J/ov+iv7///7//v/5//z/5f/3/8H/8v+N/+v/
PP/j/9/+2v+4/s7/tf7A/7L+rv+w/pb/rf52/6j+S/+h/g3/hv6x/rD+LPfeHIr+RnWP/zq0xP+lz9f/8d7g/8bo5P+o7+f/pPTp/1T46/8P++z/Bv3t/1/+7v86/+//s//x/+P/
7f/r/4DMSykD81N2fPtFtGL9Ts8Q/lneYP4I6Iz+ye6m/qzzuP5L98b+9/nS/uH73v4x/ev+Bv79/nr+Ff+p/sT+sP60siBMc+ShedT0eLTS+FfOQfqu3Ob62uU9+z3scvvY8Jj7
PPS2+7z21fuH+Pf7v/ki/IP6YPzu+rv8F/tf+x37JK+4cR3cAn8t7+u0EPT2zMb1MtqD9pbi4vZn6Bz3lOxH96TvcPfk8Z/3fvPc95X0MvhD9bP4oPVz+cP1OfbH9ZW2547n2XWG
eOvGtQHwist58VfXCPLH3kjy6ONu8oznkPI76rvyK+z48o/tVPN87t7zEe+y9F3v5vV47xLwe+8zwzamJNwzkO/pZbdR7anKMe7v1GTuV9to7rHfae7L4nfuC+We7qvm5+7S52Hv
l+gh8A7pR/FM6c/yYOkJ6mLpCdFpu/zg5Jx96iG6eewDy6js0tNv7DfZL+zZ3AXsa9/760PhGuyX4mvsh+P87CPk5e2C5D3vseTB8MDkYuXA5Hndec/Y5i6tu+wyvontE80i7ZrU
j+wg2RTsINzD6zneouu437XryeAF7IfhnuwD4pDtTOLi7m/i9e934gTjeeJX56bfjeyLv/PvgsMD8L/QQ+9R13ruIdva7Z3dbu1T3zrth+A/7WPhg+354Q3uWuLk7pHi8e+q4kPw
r+If47HimO6i6m/xsNBe87zJHvOL1Ufybttx8bjexfDM4E7wN+IN8DXjA/Dj4zHwWuSa8KXkN/HO5Njx3+Rc8eTkOOXl5LfztfFG9Vvfbfbw0Cb2ttpo9TTgpvQh4wX06uSQ8xvm
SvPr5jHzeudG89fng/MT6NrzMegI9Dzo6vJB6H7oQ+hG9z/2JfiY6uH45dm1+JHfJvjs5Ir3oucC9zfpmfY96lT27Oow9mLrK/av6z722+tS9vDrIfb466X0/+sp7ADsv/k0+T76
x/K8+hzkrPrK40/6Fend+bvrc/kz7Rz5Ge7b+LDusfgS75n4Ue+J+HPvaPiB7/X3iu9a9pDvru+R73v7MPvE++/3GfxD7Rz8tufm+3Xsmvst70z7lvAH+2zxzvrw8aH6RvJ8+nby
U/qP8hD6nPJ5+aby5/es8sHyrfK2/Iz84Pza+hn9t/Mk/ajsCf3y7tj84PGi/FLzbfwg9D38mfQQ/OT04/sL9az7H/VV+yv1r/o29T75PPVL9T31mf2B/bH9lfzW/cr34v2a8tX9
yfC4/dbzk/1s9Wv9PvZC/bL2GP3z9uj8E/ep/Cj3Svw196T7Qfdc+kf3UfdH9z/+Mf5N/qv9Y/6O+mz+Xvdn/kfzVf4U9Tz+8PYd/tX3+/1M+NP9h/ij/aj4Yv29+AH9zvhj/Nr4
Rfvf+Of44Pi7/rL+wv5j/s/+oPzU/jb60f4898X+2fWy/uP3mv74+H3+e/lY/rn5Kf7d+en99fmL/Qr6+fwW+gD8Gvoh+hv6GP8T/xz/4/4i/+T9I//1+yD/bPoW/7H3B/9D+PP+
rPnZ/kz6t/6b+ov+x/pN/uf69P39+m39CfuV/A77E/sP+1//XP9h/z7/Y/+o/mH/N/1c/yz8U//D+kb/yPg0/9T5HP/I+vz+O/vS/nf7l/6h+0P+ufvI/cX7C/3K+8/7y/uW/5T/
l/+A/5b/Jf+T/0X+jP88/YL/fvx1/0D7ZP/X+U3/zPov/4/7B//w+8/+KfyB/kf8Ef5X/Gn9Xfxg/F78wf/A/8H/s/+//3j/uv/y/rL/Bf6o/2H9mv/M/In/8ftz/7/6Vf9j+y7/
Jvz6/oT8sf6y/Er+x/y1/c/80/zQ/OT/4//j/9r/4P+y/9r/Wf/R/7f+xf/1/bf/gP2l/yL9j/+//HL/KPxN/777G/9z/Nf+6Px4/hf98v0n/S39K/3///7//f/z//n/0P/x/47/
5v8s/9r/nf7K/9j9uP+L/aH/gP2F/3n9Yf9y/TL/af3z/l39nf5P/ST+Wf1z/XH9NPXLEiL+mFtv/0Cgtv/OwdD/KtXc/9jh4v+86ub/PfHp/wr26/+U+e3/Jvzu/+j97/8F//D/
pP/y/+P/7v/t/z7FaiO17wZdU/p3oOX8pcHb/c/UT/5I4Y/+Duq1/nXwz/4t9eL+rPjy/i77AP/m/A7//v0e/5f+MP/U/ur+3f5yquhNyt2TYS/yK6HP9z/B+Pmy0/z6ud+J+xvo
3/s77hr8u/JG/Aj2bfxq+JL8Cfq9/A/78fyd+zD90/sG/Nv756XLck3TDGmC62Wi2/K3wLX1INIK917dwPcy5S744up7+AjvuPgV8vL4Q/Qx+bz1f/mp9uX5J/dl+lb3qfdc96Sr
oovez2dzR+cepNnuQsDF8UbQGPOM2sfzqOEv9MnmevSH6r30Pu0E9TLvXfV98NP1S/F19rfxPPfd8Uzy4fGqtj6fntGpgITliKYt7BbAqO6MzrPvvNcz8AXefPCK4rbwzuX08Cvo
Q/Hb6bPx9+pS8qTrMfP96yr0Guyb7Bzs58O/sZzW0ZDh5cWpBuuawMfsdc1k7YPVnO342rft297V7abhB+6p41ruEuXb7v7lnO+N5qXw0+aZ8ejmbufp5g3RLMQn3SCj4uf3rWnr
G8Ji7HfNiux21HbsJNlg7HDcX+zK3oHsduDQ7KDhWe1h4iju0uI27wjj1e8V45XjF+OV3IjU8+OHtfXqT7Me7cLEcO3dzjbt+NTj7PTYoey424Psst2S7BLf1ewD4FXtneAV7vbg
9u4e4fXuJeGW4Sjh2+Uq4SjqP8aB7iG6su+CyJbvoNEd7/fWn+5r2j/uvtwJ7mLeA+6E3zHuSOCX7sTgKu8H4bHvIuHs7inhhuEr4efsR+pd70bV/vHzwp3y/cxM8l7VufEu2irx
Md258DDfcvCP4FjwgOFr8B3iqPCA4vrwsuIR8cPik+/L4hTjzeIW8qPwfvMQ4hX1Bs5q9dzREfWg2YL0Fd7288jgg/OH4jPzseMH83fk/fL65AvzR+UU82nlvfJ35bnwgOW45YLl
2PUL9af2Vuyi973Z1vf11o335t0U9y3imfan5C72Oebc9TznovXm5371UOhg9YvoKPWj6Hr0segu8rvo5ei96JD4HPgH+V/zpPln5Mv5ytyZ+cfhPfkE5tn4a+h8+NzpLfjD6uv3
Vuuy96zrcffY6wb37Osd9v3rwvMH7CbsCeyJ+kf6zvqv9zH71OxQ+/XjMfst5fH6WOmk+sbrVvom7Q36/e3I+X3ugfnG7ij55u6c+PzulPcP71H1GO8w7xrv+/vV+yP8X/pg/NTy
d/yE62b8e+g7/APsAfyO7sP79O+C+8PwPfs48e36cfGF+pPx6Pms8dj4wPHC9snx2vHK8Q799vwl/R78Sf0v91j96fFO/cvsMP0M7gb9tvDT/DvymfwK81b8dPME/K3zlvvT8/L6
8fPo+QX0CPgN9Bv0D/Tc/c396P1M/fz9c/oE/kb2/P0V8uf9++/G/TvynP3v82j9z/Qp/T711/yA9Wj8q/XG+871yfri9SD56vX19ev1eP5v/n7+H/6I/nz8iv4u+YH+kvZv/irz
VP448zD+EfUB/hn2xf2g9nb98vYJ/Sj3bPxP94H7Y/cK+mz3dPdt9/D+6v7z/rj+9f6//fL+V/vo/mv51/4097/+zfSe/pL1cv7l9jn+o/ft/Q74hP1V+PD8gfgY/Jj4zPqh+Kj4
ovhN/0n/Tv8o/0z/j/5G/xf9Ov9B+yj/7PkQ/wr48f5W9sj+I/eR/jn4SP7c+OT9O/lZ/XP5kvyO+Wz7mPme+Zr5lv+U/5b/fv+S/xv/if83/nv/pPxp/3X7UP9t+jH/GfkJ/7X3
1P43+I3+Pvkv/tn5rP0o+vb8Tfrv+136Y/pf+tD/z//P/7//yv97/7//5f6w/9P9m/9//IL/qfti//76Ov9V+gb/i/nD/ib5af7l+e/9jfpH/dr6Wvz5+gH7/vr///3//P/r//T/
rv/n/zz/1f+W/r//pf2k/2f8g//C+1v/pPsp/5H76f6A+5X+a/sk/lj7jP1F+7f8X/uB+377LfPyDLP9W0ZL/xGMpf//ssb/ccrW/xna3/825eT/X+3n/2zz6v/o9+z/Jvvt/1/9
7//J/vD/kP/x/+H/7v/u/9u+GCJb7EpI+fhhjDz87rKA/SzKHP6s2XP+peSo/rjsy/6u8uX+GPf5/kn6Cv91/Bn/2P0p/5n+OP/m/vv+8v7+o2tSX9dqTgbvho1B9tmyMPlwyZ76
eNhp+xPj5vvZ6jr8lfB3/M70qfzb99X87fkB/Tz7L/3w+139Nvxe/ED8Ap+PdADLfljt5jKPoPDQsrP0asiz9rXWz/fD4H34E+jy+HjtSflr8ZT5Q/Ta+Sv2Jfpg93v6AvjQ+j/4
ffhG+GSjZIlbxi5myeHRkT/s/LK+8ETH8vKY1Cf0693j9K7kY/Wj6cb1Pe0g9tLvfPaJ8ef2m/Jo9yrz4/dc867zYPO8rNmZW8fBdovfCJVo6XKzr+0sxr/vY9LZ8N/agvH84Pfx
dOVY8qvouPLz6ibzd+yu82XtV/Tc7eb0BO5m7gburrjOqRXMN4m73y2ZIehitL3rcMVq7XPQRO4R2MLue90c723hbu865M3vNOZG8ILn5fBI6Knxqugk8sfoMunI6HHFRrri0guc
uuFWnkro8bUF61TFMOwuz7fs6tX+7KTaM+0P3nDteeDG7SfiQe4+4+nu4uOu7y7k2u9B5K7kQ+SV0ezJbNqrre3kwqSs6U24heskxi3s685f7NDUbezr2Hzs1dug7OTd5uxM31ft
MuDy7bTgke7u4DHu+eBi4fzgLNw617vhlr3B6AGt9euKuw/t8MdJ7dHPNe351BHtidj87AfbBO3D3DPt7N2L7ajeAO4O31PuNd867T/fnN9C39fky+E36EzMtuxkt8Lumr9R77DK
P+/R0fjuZtaw7oDZfO6i22nuGN167g7eq+6o3uTu9N7O7gzf9OwY32jfG9+f683pou2o2W7wjMOy8YDE6/Eszq3xudRK8d/Y6/Ca26Lwc9118K3eZPB632Xw899V8CngzO894Ezt
S+CM4E7gyvC37/nxO+Wx893Pd/RzyoP0EdI29C/Yy/MG3GPzfd4M8xvgyfIq4Zfy0uFl8jLiC/JW4hjxbOIo7nvir+J94qv0CfRe9dvta/ZL2+X21tHf9hTWlPbQ2y/2et/I9cHh
avU34xb1I+TH9LDkZ/T05MzzFOWI8i7lYO895WblP+WR9zH3+veZ8574HOXr+JHa4PhH2qD4Vt9I+Oni6PcW5Yr3buYr9z/nxfaz50H25+d19Qzo+/Mo6M/wNuhX6DnovvmE+fv5
afde+t/sjPpd44L6Gd9P+n/iBfoI5rD5M+hV+X7p8fg76nv4mure98/q8vb26l71FutT8iTrPesm62H7PfuE+/v5vfvs8tj7KuvO+xDlpftr5Wj7r+ge++rqx/o37GL65Ozj+ULt
Ofl+7Tz4rO2k9svtz/PZ7e3t2+2f/In8svzE+9L8jvfe/B7x0vyZ67H8w+h+/NDqPPwg7ev7e+6H+ynvBfuU71T62+9T+RHwx/cx8DH1PvBP8EHwk/2F/Z39Cv2s/Y36rv1v9Z/9
Z/GB/UvtVP267Bn9v+7N/DDwa/wI8er7ifE5++LxPfog8sT4QfJu9k7yXPJQ8lD+R/5U/vj9WP52/FP+xfhB/o71JP5f8vr9h+/D/dPvev1j8Rz9dfKd/CDz8fuQ8/361/Oc+fzz
hPcL9Bb0DfTj/t7+5P6p/uL+uP3X/nL7w/5y+KX+PPZ8/przR/6O8QH+EvKl/WDzKv1R9IT86/Sc+z/1VPps9XL4ffWH9X/1WP9U/1f/MP9R/5T+Qv8u/Sv/sPoM/6n44v719q7+
DvVp/nfzEP7I85n9APX6/Nr1H/xb9u/6l/Y9+a72t/ax9rT/sv+y/5n/qf8t/5j/Pf5//4z8Xv9k+jP/8Pj+/s/3uv7D9mL+yvXw/Xb1WP0x9ov8A/dy+3b36fmm97L3rff///v/
+v/g/+3/e//Y/8v+u/+w/Zf/OPxq/yP6NP8S+fD+zPib/qH4Lv59+KD9Vfji/Dj44vsb+H76Qfh/+Hv4HfGACT39vDUk/7R4kf+Do7r/9b7O/6rR2f8k3+D/F+nk/5Hw6P8J9ur/
Cfrs/8P87v+D/u//ev/w/93/7v/t/zq5eCMJ6UU4gPcgeXT7g6MJ/b2+0f1J0UD+od6F/nvos/7b79T+QvXu/jb5Av/i+xT/mf0k/4n+Mf/p/v7++P7gnrtXY9FIQJvrgHpU9KSj
Dfgyvuz5StD8+kbdpPvU5hX89u1m/Cvzpfz49tr8hvkK/Sb7N/0I/Fv9XvyA/Gv8x5lPdovDS03x4d18uO0HpALzhr259ejORfdQ2zv4a+Tg+DDrWPkf8Lf5sPMJ+hb2V/qW96T6
Y/jf+q/44Pi4+CadxIflvUtestszgKXoqKS07s+82fFDzaTz8djA9Hvhf/XI5wz2XuyA9qXv6PbZ8VH3NvO99+nzBvgp9Gn0L/QBpaKVGr5gccXYioRk5Zeld+stvKPuiMtu8F/W
ifE+3kjyA+TY8jXoUvMo68nzI+1G9FXuyfTw7g/1I+9v7ybvfa9Yo0bCtISd2PSJ5eP+pmzp0rtL7PTJ5e3e093uB9uF7zjgB/D7437wlub58FPogvFb6RHy3Okx8gHqV+oC6ke7
3LHlyOqWjtqUkPHj7aiT6OO78OrEyDfsuNH47CfYee3A3OLtEuBL7lniwO7Y40nvtOTO7xzlmu8z5ZDlNeU0x1HAtNBhp+rdr5g+5YCr2eiJvJ/qNMiE6z7QA+zx1Vbs/9mf7OLc
8ezV3lftGODO7c7gK+4c4XHtKuGI4S3hV9KHzbTYTbYW4o+ie+fRrhjq7b1K63bI0Ouszw3sr9Qx7D/YVuy22ovsYtzU7GzdJe3+3TrtMt7O6z/emN5D3hXc3tgy4GTEjuYvrlLq
D7MW7AbAyuyayf/sEdAD7YXU+uyf1/vsu9kM7SbbLO0A3ELtcdzy7JPcwuqh3PLcptwx5B7ixua30ezqwrpv7WC4i+7iwuDukMvY7nLRru5t1YHuIdhe7vjZR+4k2zTu1NsA7iTc
Oe1A3E/qUtya3FfctOpm6Uvs5t3r7hPHifA5vy/xXcZE8TPOFPGg08vwO9eA8KLZPPA42/3vNtyx78LcLO/43O/tF91u6ivdaN0v3dDvAO/G8KnnZ/K00mnzxMfD83nKsvNP0Wzz
YtYR87XZsvLe21LyQt3s8RreavF/3pfwsN7y7tPeDevp3hvf7d7E80PzWPS17lb1Sd3y9VLRHfZSz/r1qdSs9WrZSfWQ3N30kN5o9M3f4PN/4C3zzuAY8gLhJfAr4RPsQeFq4UTh
z/Z+9ib3sPO+917mGfjV2in4Y9X+9xvYsPd33Ez3hN/Z9m3hVfaI4rT1F+Pa9GzjlPOn42/x1eNe7ejjCuTs4yb59PhZ+Tb3sPny7eH5pOPg+ZTctPnk22n5Wd8I+VXilPgu5Ab4
M+VT97/lX/Yc5vj0YOa88pDmz+6l5sHmqOb1+tX6Efu9+UD7+vNW+/7qSfsd5B37i+DX+gvievrK5Ab6p+Z0+arntvhI6LP3s+g89gTp/vM16UvwSulh6U3pXPxH/Gr8lPuA/A74
hPzM8G/8EutC/DrmAPwC5af72+Y1+6noovrV6d/5lurV+BfrW/dz6yz1p+u+8bvrz+u/63T9Z/17/fL8gf3D+nj9f/Vd/ZfwL/1M7O789eiZ/K3oKfw86pb7n+vT+ozsyvk07Vf4
n+0/9tftGfPt7f7t8e1S/kn+U/77/U/+l/w+/kf5Hv6/9O/9WfGu/dztWv1s6+z8iutb/Onsm/sg7pb69+4v+XrvNffA71T02e/o793vAf/7/gD/xv72/tz94P7K+7z+FviK/tz0
Sf458vT9qe+H/dPt+fzr7T38L+9A+1Lw6fkB8Q34XPFs9X7xjvGF8Y3/iv+K/2T/ff/B/mP/V/07/876B/+F98P+K/Vu/lrzAv7N8Xb9pvC//FrwzfsY8Yf6B/LL+KHyZPbk8vby
7vL+//r/+P/P/+T/NP/D/yD+lv+H/F7/PfoY/0P3wv5I9Vb+vfTO/Wb0H/0f9Dr85PML+7bzdPm080P3/vMo9CD0Be93B8L8Kyn5/tpme/8QlK3/8bLF/6vI0/+V2Nv/deTh/1zt
5P/78+f/zvjq/xj87P81/u3/Yf/v/9n/7f/s/0C0eybG5WEs9vViZ5X6IpR9/L2ycv1SyP39GNhT/t7jjf6p7Lb+NvPW/vr37v40+wP/SP0V/2z+Iv/f/vb+8f7BmuVc48uANhro
Kmkr8lmUqPZQsvz4a8dU+tXWK/tL4rz72+ok/Dfxc/zJ9bL85fjp/N/6GP3y+zf9W/x6/Gr8vpXVd/i8okbh3DVsZ+rzlNjw07FH9DrGSPYT1Yz3FOBm+EPoA/lS7nv5pvLe+Zj1
NPpw93/6avir+sf48fjT+F2Yi4aWtoBagtWIcHHk/pXx62exB/DbxHDy+dL182Xd/PQh5br10OpO9tbuyfaS8Tj3QPOZ9x/0xfdt9KH0dPT7nlCSGLYMb8/RIHaU4F+XTugcsZbs
dsMf77jQuPB22szxpuGV8unmM/OW6rvzEu039JLupfRV77r0k+/R75fvF6gdnp25IYIt0RN9tt5VmQbmFLEd6ivCh+x3zgvudtcP7xXezu/Y4mfwL+bv8GTob/G26dnxWeq68Yfq
zOqI6rKy06rCvyCT6NJuhZXe1psJ5WCxp+gjwcXqdMwV7KzU9Oym2pjt7t4f7ujhm+7Z4xHv+ORl73rl6O6Y5eblmuXsve23a8c5ok/WSo/Y3+2eNOUjsjHojcDo6drK8epL0p3r
qdcb7HHbhewO3ursud9F7argae0P4WPsIOFz4STh+ciJxKvPEbC/2pSaJuLeolrmcLOo6IXA7unhyajqkdAb61LVbeuq2LLr7dry61PcIewX3fnrXt1E6m3dwN1y3TfTCtDI12K9
rN/rpiXlx6dD6Fi17Okgwcbqockz65/PbOvZ047ryNao67HYuevg2anretoa66janei72grbwNo83AraQd9TyqfkfbOE6PuttOr5t83rcsJJ7CTKc+yRz3bsVdNp7NzVUuyC1yrs
e9jM6+bYw+oO2XznJdlu2SvZ3eNk4s/lntZf6Ya/++u6tW/tUrsW7mrER+5yyzruW9AO7rXT0+301YrtWtci7R/YbOxq2OLqk9jl5q3Y79iz2CDqKela6xLhou3/ylPv5r468KO/
jfD3xofwYM1Q8OXR/u/x1Jvv5NYg7xLYd+6n2Gft7Nhi6xvZ1+Y32XHZPdkq74nu7O8u6Vfx29Vj8sDI6PIjxQHzBcrW8sTPgvL50xPywtaN8YbY5PCB2f3v89ma7j3aLOx02kXn
kdrD2pfaKvPD8qDzRu979MPfGfWN0lr1C8xO9bPNDPV70qX0ZNYi9ALZf/OU2q/yYNuT8dXb6u8q3C3tadwb6IbcsNyL3FL2EPaY9s7zF/eI6Gz37duB9+7TXvcs0g/3WdWd9u3Y
C/Zl21T10Nxl9JXdHvMZ3kHxet5S7r7eQunb3v/e4N7P+KT49vgt9zv5z+9h+VTkWfkY3Cj5xdfR+IXYWvhp27/3ut359hLf9PXw35D0iuCR8vrgiu9C4ZzqXuF94WPhxvqp+tr6
s/n6+gP1Aft96+f67+Os+k7eUvpe3Nf5y904+cHfaPhB4VX3ReLf9fvizvN+48bwyOMR7ObjAeTr41P8Qfxc/J37Zfyc+Fn8kvEy/LDq8fsr5ZP7QuEX+0zgdfqc4aH5L+OH+Gnk
CPdM5fT04+X68TbmjO1W5m7mW+aQ/YT9kv0U/Yz9Iftz/ZH2RP0x8P78T+ue/NvmIfzt4337jeOn+s/ki/lD5gz4Yef/9RXoIPN06Pzumuiw6KDojf6F/ov+OP59/ur8XP79+Sf+
zvTc/QDwev0q7Pv81ehX/KnmgPt+5mb6veft+BXp7vb56TH0depY8Kfqveqw6ln/VP9V/xz/Qf8x/hr/KPzg/of4kf7J8yz+M/Cr/XTtBv1I6zL87ukc+6rprfll6sP3Zuss9SXs
mvF47JLshuz+//f/9f+5/9f/1P6n/1T9Zf/7+hH/mfeo/i3zJf5B8IL9N++y/Jrupvsj7kn6x+19+I7tFPaf7cvyA+4w7iXu6exKBkL83h/M/gpXZP/2hJ7/lqa7/zW/y/+S0dX/
ed/c//Hp4f/K8eT/c/fn/1776f/j/ev/Rf/t/9T/6//r/9evfSqX4tIjYfS3V6f5CYXh+2qmBP3Yvqv9E9EU/tveW/486Y3+/fCz/pT20f5x+un+6vz9/kT+C//M/uX+4v5kl4hh
2sY4MJvk/Fne73GFFvUXpt33Ab5++dbPh/pO3Tv7a+e7+/LuHPxc9Gj8GPin/HL62/y5+/n8N/xV/En8kpIZeTi3ZkPv19xd4OZRhlruwKV78ue89PQrzon2Ltuc9+bkYvgW7Pf4
QfFt+cv0z/kA9x76LfhD+pz4wfip+KKUmIVZsJFZh89VY/Hfsoey6H+lru2zu7TwN8yo8p/Y/PPb4fD0qeip9YXtPfbS8Lf22vIX9+fzM/dF9HH0TvRAmqqPTK+UbhPLbGpc25+J
gOR1pdTpfLoZ7SDKNu/U1afwgd6w8dzkefJf6RrzZ+yg8z7uA/Qo7/zzdO+m73jvJqLfmS2ytYDoyQhzAtkojNbhtKUT52a5T+oPyGbs99LR7Qfb1u7o4JvvCuU68MfnvPBk6RLx
LerJ8GXqnupn6pOr/qS4tz6QTcsUfZjYXI+e4EqmcOWHuGroJ8ZU6jnQnuul14jsAd057cDgx+0o4zXukuRo7jTluO1Z5ZvlXOXhtbuw9b7wnZTOZYjB2VKTq+BKp9rk/7dt54zE
D+nJzSPqitTj6mDZcuur3N/ryt4q7P3fIux/4OPqleDd4JngcsB5vBfHrKod05yUGtwrmMfhx6g35ea3Tedgw5jozctq6enR9ukx1lfqGtmY6vDarers21DqRtxf6Fjco9xd3LLK
tMdvzyK3WdgroUbfG562496qY+ZJuPjntcLm6F7KcenZz8PpqdPu6TfW9+nB18Xpi9j76MPYPeba2CbZ4dgt1P7RdteBw9Tdba3v4kylPuanrTToPrlO6bHC4+mcySnqiM496urR
Leod1PTpadVr6fnVIOgl1orkQ9aL1krWmNwK28/elc8x4wu5y+bNrSPpRrF66s26KOtOw23rl8ly6wDOS+v90P3q4dJ56uzTj+lP1LfngtRT46XU6dSs1NLjv+JH5VraMeg3xJ/q
T7cv7AK2BO0LvVntgcRb7T/KJ+07zsfs4NA77H/SautA0xnqnNO059nTnOIA1D3UBtTg6STpzuo6463sCs897iPBNe8VvKbv+r+170nGgu9+yxzvGs+K7nnRwe3R0qTsaNPv6s3T
COgU1GXiPdR01EPU2u5b7m7vS+qX8FrZiPHnyhHycMM58srDFfKMyLjxMc0r8YTQbfCe0m7vsNMK7lDU+uvC1KboFdWl4jvVbdVB1eXykPI+88/v7fPr4nL0fNSu9JnLofTDyFn0
Xsve80HPM/NE0lDyE9Qh8RvVge/M1STtUdZ+6anWTuPP1vzW1tYo9u/1W/YT9Lr2Nev39o3d/vYM1M/2885t9tbO3fWD0Rv1ItQb9MbVx/Lm1vbwsddg7kvYguqo2E7k0dj42NfY
x/ii+OL4X/cP+XbxHfnJ5QH5bNy6+PTVR/hH06j3BdTV9uvVwPWg11D04thb8tLZnu+G2qTr6dqM5RLbNtsa2+P6yvrv+u75/PoE9uz6Iu25+ibkYvpX3eT5vNg6+QjXXPja1zj3
d9m09eraqfMJ3Nfw1tzX7ETd8uZx3ZHdeN2X/Ib8mfzu+5L8T/lv/FjzLfzr6sv7VuRF+8velPo82675TNqA+Erb8fbT3Nr0MN4C8hzfEO6b323oz9/t39jf9/3r/fT9gf3g/bb7
sf3C92b92fD8/CHqb/zY5Ln7neDN+gTemvmD3Qb4ot7u9R3gHfMy4UXv0eHs6RfiNeIi4hX/Df8O/8D+8v52/bv+p/po/q719/0l72X99umq/Armu/sa44f6geH1+Djh5Pbw4ST0
/+Jx8NDjZes25FnkSOT9//T/8f+b/8f/YP6C/y78JP/2+Kr+NPQT/lPuVf3G6Wb8+uc1+/Pmrvk65rD3tOUR9X7llPG85dvsJOZR5kLmzOqmBb37Bxmd/nJJSv+xdo7/T5qw/3y1
w/9Dys7/KNrW/z3m3P9W7+D/+vXk/5b65v+E/ej/Jv/q/83/6f/p/+urFC9838YdxvJNSq34z3Y5+yGaivwbtU/9vcnL/YLZH/575Vv+fe6I/gz1q/6X+cj+efzf/hD+7v6y/s7+
y/6dlI5lP8KNLC7hJE2A7WN3ZfPZmZv2QbSG+HrIwvnq15r6nOM0+2PsqPu+8gP8IvdM/Ob5hfxk+6b8+fsX/A38CZAhejCyo0I10/5RRuOOeKrrk5lx8DazXvPNxkX1wNWT9gvh
hPd86Tj4ku/G+L7zNvlW9oz5ufey+Tv4XfhK+K+R1oQJq2Va5snTWFzbXXoq5YWZ9uoVspTu48T08DLTmPII3sbzCeao9MnrWfW07+T1GfJK9lnzX/bG8+3z0PN9loiNkKkdb8jE
eGEI1uF8T+C8mZHmAbGJ6t3CKu110PnutdpH8EDiQPGf5wHyPOuX8mjt+vKB7uXy2+4G7+DuW51pluCr+X8Xw8ZrJNMlgCjdPJpp4w2wbOfcwBXqp83r60XXOu1K3jPuPuPx7obm
fu9+6Mvva+lq77Dp3+mx6bKlKaDLsP2NF8RHd13SOoSc2yWbfuFRr0vlAL/Q5/LKienY08HqUdql69beTOzM4b/shePe7E3kDex45LDke+QIr6GqerdZmhzHmYNS0zSJetuCnLzg
264j5GO9YeZ1yOTnoNDw6IjWrOmd2i3qPd1x6rbeS+pV3+Tobd+t33Lf5bhntT6//aWRyzCQodUjj4TcaZ4A4cuu5OMlvMXlR8YA58LN0Occ01fov9ah6AfZpuhA2iDor9oA5sPa
CNvJ2tHCFsCAx46x7dCQnOnYJZZ93umgIuIxr3XkRrvt5YfE1uZTy2HnH9Cn51TTr+dK1WLnSNZl5o3WcOOo1vDWsNZgzEnKwM8/vbrWVajS3D6eJeEwpPbjEbC45eq6xOZWw1jn
csmZ57vNl+eK0FHnMNKi5ufSGuUj00HhRNOM003TO9Wr05rX6ciX3HSzDeFEp0DkZKhO5ouxh+cUuy3oqcJu6DXIY+gFzBXod85458rPXOZD0DrkhdB837HQ9dC50CrdB9zJ3rTT
OeI8vlrl1rCX57Kt/Oi/s7zpz7sG6pvC+OmYx6Tp9MoJ6QrNEegHzn7mfM6948rOK975zjrPAc8T5EPjJuUQ3XDn3siE6X26/OoytNXrw7Yv7CO9Kewcw9brlcc9647KVepMzADp
Es335o/NnOPszVPdHc5ZziXO9ulk6afq5uQd7EzTau0MxEjuv7uz7ta6u+4Tv3PuJcTk7R3IDO23ytzrFswt6t/Ms+dvzcvj2c3y3AvORM4Uzubuge5U70/rNfBP3fPwm81h8efD
ePETwEDxv8HD8KPFAfAOyfPuOsuB7YLMgetizaDoB85C5HvOBd2uzuLOt8798rfyPfN48LvzU+YW9P/WM/RazA30d8am813FAPOSxxXyPcrY8BnMLe92zebsc86w6TPP9eSwz3/d
5M8T0OzPW/Yr9n32mPS59oLt0vb437j29dRm9pzN3fUdyhf1FcoM9IzLqfJSzdDwzc5P7vHP1urR0NzlVdFU3ozRt9GV0R35/Pgs+eL3Pfn88iv5Wejs+FXdffgx1dr3zc/+9jzN
2vVmzVn0085c8l/QsO+70Qjst9Lo5knTcN+E06zTjdNf+0n7YvuC+lj7H/cq+6nv0/ok5VD6vdyc+fvVrvij0Xf3DNDh9ZjQyvMY0gHxpdM97cPUEeho1cDgqdXR1bbVOf0q/TX9
m/wZ/Tv62vwZ9XP8Tezi+23jIft43Cf6N9fj+AjUPvcg0xb1FNQ98pPVcO7O1kvpkdcz4ubXDdj1177+s/61/kr+jv6M/EP+yvjQ/TnyNP2c6Wn8heJl+yndGPpX2Wv4Zdc99gjX
YvOw15vvw9iQ6qvZveMe2kvaNdr9//D/6/92/7H/yf1T/9b60P489ij+EfBT/fPnSfzG4fr6+N5O+VzdKPdK3F70s9u28Hbb3uuj213lQ9x23GLcruhaBTP7AhRs/hQ+MP+UaX3/
V46k/6Wruf+jwsf/itTQ/1ri1//J7Nz/bvTg/7354/8i/eX/BP/n/8f/5v/m/2yo+DN43JoZKPEjP6z3vmmH+iaOB/w+q+n8EsJ5/dfT2/2H4SH+3+tW/mzzf/6p+KD+Afy6/tb9
zP6R/rH+rv5LkvpoCL7VKtndoUIa64Jqn/HfjUD1XKp0977A4vgp0t75i9+U+qbpHfv58If7CPbb+zv5Hfz5+kL8pPvE+7z7+434esetkkO/zo9Ir98JbN3ovo087k2pl/EGv8/z
6c9Z9d3cdfaa5kv3pe3x93ryc/h79dT4Fvf++K33z/e/91CPOoR/pj5cscTSUNfWX25+4dmNAOg5qCrsFL307lHN5vC72U/yBeNd87PpLfRD7s70DfE+9X/yVfUA8yPzC/N2k8uL
uqQocAW/IlvN0JRx79tLjvviNqeV5xC7suqNyuDsWdZ07hnfoO9e5YXwmekv8SzsmvFz7YDx3u0C7uLtd5mQk5Cmln/dvO1mXc21dT7YI49W316mCuQWuT7nvcd86dXSGesM20ns
2+Aq7bzkye0N5xfuKuiq7Xroouh76NigJpzjqi6MdL2Qcy3MynpN1nSQDt3EpZXhRret5PfE1eZTz13o/tZ36VbcP+ra373q4+HV6tDi8OkB4zPjBeM/qXql+bBQlyXAX4DdzNWA
6NVNkgzcdKUy4K+1BONgwvbkAsxQ5gHTP+fm19rnENsi6NHc6eeO3WbmqN3h3a7dUrJGrzy466FjxOaMCc/Xh9HWvpQr3Iilyt9YtDziFcDh4/HI+uRUz6zluNMI5nzWBOb+12Hl
g9gd45jY19if2Le7RLkxwJisscnOmFPSz4/G2OSXQN0epkTgZ7NC4iK+jOMwxlbkBMy95O7PyuRQ0mnkhNNC49fTIeD20zrU/9MRxR/DZMiMt6DP+qNj1pCYh9vUmxvfJad84eWy
AOObvOfj8MNZ5B7Ja+SQzB3kns5N43zPjuG9z3zd588s0PHPDc6KzHjQqsLO1ZGu6drbodbesqCO4deoT+Peslnkgrva5BfC8eTExqjkxMn1423LqeIEzEDgUsw324PMyMyOzGjW
QdUe2EXN7tvsuJ/fVqt54pOmaeQ2q5blVbMs5vC6TObSwAjm8MRg5X/HQeTByG7iRMlU36bJWdncySDK58n33RvdJN/b1sLhRsNN5LC0P+ZprYLndq4s6Gy0Wejduh7oEMCB56bD
e+bMxezkscaP4lLHwt6/x+jX/Mc8yAXIo+QC5GvlP98k56DNyej7vf/p/7Sy6sey7eo7tr7qXbsw6sq/QOnfwt7nesTi5W/F/OIdxoTeoMbq1tzGG8foxmrq9unp6mnm++vS1/Ts
YceY7fm82e00uLjt1bg87V68ZuzzvyrrYsJx6djDDOfcxKXjpsWS3jjGXdZ5xrLGg8ZX7wXvpO9r7EDwT+G98NzQ9fA/xd3wk7508IC8ue/0vaTuZMAl7UTCHevGw1no7cR95N3F
5t51xj7WusbwxsTGgPNG86rzYvH18zvpG/RD2gb01s2t85XFDPM+wR7yQMDV8BbBHO+1wtDsPcS46ZjFeeWexnffRseG1onHvseWx/z20/YP93X1JPeW7xD3YOPF9o3WPfYezXL1
z8Zc9EfD6vKWwgHxmsN77hzFHuulxpDm08dA4ITIKtfPyALJ3cjj+cf55/nJ+Nn5lPSf+Z/rMPka34f43tSe98bMavaAx9b0JcXH8h7FFPBoxoHsDMi551jJN+EhyhzYc8qhyoDK
Tvw7/Ej8gfsk/Hf40fsJ8kr7ReeL+hvci/lU0z/45syT9v7IZ/SZx5PxRcjb7bTJ7ugLy1Pi8MtO2VHMgsxjzFH+Q/5F/rn9Ev5v+639jvYU/SfuQ/xB4zP7/9nV+f7SFvgrztj1
xsvw8kPLJu/cyyvq5syQ49XNtNpXzozOcM78/+r/5f9G/5b/CP0X/xH5aP4j84T9Fetm/MXg/fpE2Df5LtT09t7RDfR80Evwwc9l64LP8eTxz1XcXtCt0JLQk+ZNBaX6RxA5/rY0
FP/JXWv/64KX/+KhsP/lur//xM7K/z7e0f8M6tf/zfLb/9f43/+4/OL/4f7k/7//4//j/0yl9jiK2cIWiO/7NaX2Al7P+buCfftyoXz8R7og/QDOkP1Z3eH9C+ke/rDxTf6q93P+
dvuR/pX9pf5r/o7+jP5VkN9rK7qKKqHaMzq26AJfz++AgtPzhqBN9t247vcwzA/5ONvg+aXmffoE7/j61fRZ+3v4o/t6+s/7Pftg+1n7S4yne+WppEWPyk9BK9zyYAXmeoLt63Cf
ru8OtzPyzsn382LYQPVt4zf2cOv39gDxjfd09Pv3TPYs+Pn2HPcO92KNuYObopZe6r8TS3nS6WPJ3cqC5uRfno7pDrW67BTH+O4Z1Zvwq9/W8Ubnx/KA7H/zwO/+82nxG/T+8R/y
CvL+kFuKo6Blcc65+1bIy+5nhteFgzffa51f5ACz7eczxHTqitFN7Irbre3B4rfum+d675Tq8e8O7Nrvi+yr7JDsRZY1kROiaX9Btw9k1ccFbUjTw4QH262cU+AEsQPkTcGj5tvN
i+hG1/LpBd766oHisOst5QXseOaV69Xm+ObW5tGczJjfpbaKd7dncT3GJHPq0JGGVNg7nHndKK8S4Wy+oOM7ynblBdPI5jvZtOdY3UTouN9b6NDga+cI4TPhC+FdpB+hXqu7lM25
Sn6dxkF6NdD9iATXJpzH24qtHt+8u3fhvsYd49zOQOST1PnkPthK5VjaBuU023LjUNuE21bbp6wAqhSyX56/vWuKk8g7guvQHYzv1n6cKttDrBzeWbkl4HLDheHpymPiFtDU4l7T
z+Ih1Rbiu9W539TVDtbc1Wu1P7OZuTKo3sK2lcXL5YrL0vyP6tdRnYLbTqv63Tm3n9+CwKbgRMcw4efLR+HDztjgM9CO35DQStyz0PLQvNBgvpu8jsFkssLIO6DfzwSUlNWplMPZ
tp6t3M+qnt58tdTf4L134ADEn+AZyE3ghspg35XLcN3byy7ZCcxLzBTMP8fTxZ/J47wTz0KqktRWnQjZMZpM3L6ghd7AquzfLbSs4KW75eAXwaLgsMTa36vGYd5bx7fbtsdr1u/H
Msj6x8XPpc6B0SnHg9UqtJjZl6bs3IegVN+Eo+TgLqvD4USzDuLfudnhqL4m4bLB4d8mw8/dycNg2jPECNR0xLnEgcS/1+DW+tjE0NDbLL613qSvDeGRp67iJKej40CsAuTNst3j
grg746W8FuIav07gKMCc3drAYtliwQnSp8HrwbTBB99d3t/fgdnL4VbIuuOguD3lEK805rKrn+YOrorm6LL85ZS38uT8ulvjyLwO4dy9vN2mvrjYQr9y0Iy/zb+Yv4vlC+UY5kLh
U+eH0oHozcFZ6c+2wekssbfptbA86YyzTugGt+Lmg7nd5BG7EOI7vB/eKb1d2NO9Rs8gvl++Lb5F6+fqnOsB6FPsRdzw7DbLQ+3VvjrtX7fP7FK0/OvbtLrqzbb06Gq4ieb/uUDj
Q7u73la8S9gNvYfOXb2avWq9PPD372zwx+3G8MHk+vDN1OnwQ8eI8Be+z+/duLTu37Yo7cq2Euv8t0nofrmQ5OG6hd8avH3Y4bwwzjK9b71BvX70TfSU9KryrvTh65f0YN4/9AzQ
nPNgxabyDb5Q8W65hu+/tyrtKbgP6n659OUSu3PgaLzu2Dm9P86Wvc+9pL0f+Pz3I/jD9hH4tfHJ91LnPvcE2Wv2B81H9YPDwvMgvcXx3rku7yq5zusaumDnv7uA4Sm9mNkKvqrO
bL6lvn2+MvsZ+yv7MPr8+mj2kvqf7uX55+Hv+G/UqPe/yf71A8LY8zq9E/E7u3ztjLvN6Nm8peI8vnnaNL9qz6O/37+5v8z9uv28/Qf9ef0a+vf88fMw/IfpIPsy3L35ndD399jH
svXgwcvy8L4O7zS+NOq1vt/jrr+M26HAeNArwWbBQ8H7/+P/3P8L/3b/GPzP/tn26P1k7778HeVF++zXbPlRzRj3w8ci9KHEWvDXwnnrCsIj5RHC2dxuwt7R0cImwwTDeuRqBRT6
gQ0D/hYt9/5iU1j/OHiJ/1iYpf8is7f/1cjD/wTay/8259L//vDX/+b32/9G/N7/uv7h/7f/4P/g/36i5z2z1u8U6O2YLpn1r1MR+Ql47frglwn8drLB/ADIQP0K2Zz9HObh/cjv
Fv6Y9kH+5vpk/kz9e/5A/mf+Zf6rjk9uoLZLK4fXkjNX5vVU+O3ad1vy6pYY9e+w6fYQxi74vdYb+X3jzvno7Fn6evPH+qT3HPvn+U77xvrs+ub644o3fHamYkikxuw7wdhjVy7j
+neO6dSVru0Fr3vwh8N38qzT6/MB4AX1F+nf9VfvifZM8wX3YvVA9yf2SvY/9suLTYNAnx5hi7s5R0zOC1sd2o54u+HElNLm66xY6p/A3ewi0Lju/Nsf8KPkMvGI6gLyO+6S8hvw
uPLI8Ojw1vD1jimJJ52schu1mVQJx/RfMNOkeWDb4pP/4M2q8+SNvcvnXszk6ZzXd+vE36bsUuWE7a3oC+5h6vrt7+oN6/XqoJM8j0aeWn8+sqhiosINZmnOW3uj1kmTadzAqITg
f7p844TIquUX00fnvtp16NzfROnt4qTpaOQ26dLk8eTT5HWZ/JWcoX2JHrJWcKnAQ22dy7x9ftMMkx3Z6KYl3Ya3DeCmxCrims6x463VweRd2mTlHd2A5VrejOSa3sHend49oG6d
j6aEkhq0BH23wFF1ksrWgNXRPZMS11il1tq6tInd/8B03ynKyeCw0KDh9NT84VLXtOFV2BTgc9ij2HrYyKd3pbasSZu4t42Ia8IIfgrLr4R/0eqTMdYUpI3ZNbLs23q9i932xZTe
4ssb36fPF9+20U3eZ9Ld24HSt9KK0uOv+K27s06kkLwhk3HFI4fEzEqJUtIglVzWOaM32f+vKttJumnc/cET3VLHNN2oyrncT8xS27jM8NfdzBjN58xZuMG2UrvCrUnC95x5yV+Q
gc+tjhzU+ZZv18+iudkfrjLbbrcB3FW+PNwRw+bb48Xf2hrHwthrx1bUnsffx6vH78CevzTDm7eUyG6mOs6LmQXTu5St1nuZRdnjovfapqzs2+K0QdwKuwLcKb8m23PBgdk2wpvW
nMIU0dzCHsPpwmvJWMgey3DBKM/dr3HTeaIX12qb19m0nLbbgqPQ3JurP922shXdFrhT3Im759osvZfY3r3W1Fi+LM6ivue+sL6Z0b3Q1tLnysXVgLni2DOrgtuEomzduaCd3rmk
I9/7qg7f8bBj3nS1G90quBfbUrkR2Be6btOsuqPL/7pEuw27Tdmf2CzazNM33GXDWd7jsxbg3qlC4X2l1OGnptHh4qo94XuvFOAPs0Te6bSl2xS25df3tlvSo7d7yfi3PrgIuGng
4t//4PnbVuJ1zazjzLys5FuxNeXuqjvlXam75FKrsONlrg7ivbC53zayf9x0swTYe7SY0Tq1t8eTtdi1o7Xa5nPmOedV4wXoR9e86A7GJOkYuSTp4LCy6N+sw+derE3mhK055LOu
ZOEesJPdb7Fi2JmyINFss1fGzLMPtNyzmOxK7M7s2ek07Svgcu2oz2PtRsH27EK3IOwXsdLq/K386NOsf+ZbrTLjnq7S3gew9thbse3QOrJdxZ6y37KusqfxbfHA8Yjv3PHu58Hx
dtlZ8fbJl/Amvm/vwbXS7eivqOsZrc7ovawT5bCtL+A2r7jZq7D+0JKxyMT9sUCyELIR9ub1FfZw9Pz1i+6j9eLi+vQU0/jzeMWQ8na6sfDTsj/uh64T6wGt+OZ/raDh/66f2nWw
TtFwsZXE4bEisvWx4vnD+dj5o/ic+RH0F/nk6j/4VdwM96XMcvUFwF7z4Lax8BmxQe1drtToPK4b42avqNu5sN3RurHAxDqye7JQsiv9Ff0X/TP8wvyL+Bz89vAf+2HkxvmV1AT4
ocbF9QC86vLStEXvQLGb6jqwmeSRsNHcfrGs0myySsX1sjyzErP6/9v/0v/D/k7/9fp3/nD0T/3g6tH7L97v+X3OlPctwZ30Cbre8Bm2GOzys/nlFrMT3gWzzNODs0nGDrRUtCu0
Z+KmBX/5bgvN/e8m2f5fSkX/X257/zWPmv9zq67/2MK7/6DVxf895Mz/NO/S/9b21v/Q+9r/kv7d/6//3f/d//qfsULz09sTSeywKIr0vkpP+DJuWPq0jpH7uKpe/OvB6/yN1FH9
B+Of/d3t2/1o9Qz+Tvoy/v38TP4Q/jz+O/49jV9wXrPTLIrUdi4A5FFMH+wcbtvwso3Y8xKp2PXLv0D3DNJI+C3gEfmw6q35BvIp+rv2iPpG+cL6Qvpr+mX6tYmvfGqjfkv7whk4
dtVIT17gbG4p55eMn+sKp7DuDr3g8MLOfvJn3Lnzgeat9IztbPUC8vj1W/Q99jj1XvVT9XeK8oJXnKVjjbfuRFfKvFOG1ktvj96XiwXk1aTb5/25oer0yrHsG9hB7rPhde9h6F/w
fewA8aHuMvFl74bvdu9DjSiILZrlc+KwkVOYwpRZ/M7TcIzX0YqM3aOi1uHAtvfk78ZL52HTDemG3GHquuJZ64jm8et16OnrFekx6RvpapGTjQqbWH/IrVRizr27YLbJF3NF0mqK
adiToNvch7Mf4M7Ci+KXzlnkHNes5ePck+Zd4ADnCOKX5n3imOJ+4qGWm5P5nXSIX60JcH+762iDxh52rc5wiqbUvJ4E2WiwONzBvpPeu8lJ4LfRe+H+1jHiFdpT4oTbX+HJ2+vb
zNu8nEqabqKbkAivP3w9u8pxIsXxeafM+Io50jmdUdaFrU3Z0bpz2wnF8txYzOTdJNFM3t3TAN4B1VncI9VO1SnVl6ORoQyomZhOshmHq7wGe1TFiH4JzA2MC9EWnLbU66pY1yK3
LNmEwFnaL8fy2nfL79rKzRfalM6W163O3862zg+rXKmOrt6g1LbtkHi/TITbxtCDpsy/jf3QZJsg1KGoUNa6s7rXPLx+2EXCpdgBxh7Y5sec1lXIIdN9yLfIisj5souxtrWbqU28
G5pZw26Ne8nEiVHOF5Dr0S6bdtS7piHWpbAQ10K4WNeRvfrWxMDY1R3CkdN1wgDPq8LpwrnCK7v3uUq9zLJywgCjDchOlvrMOZDb0BWTsdN8m5nVM6W01uCtG9eTtNrWKrnm1b+7
FdSWvPPQAL03y0a9h71UvXXDdMITxSO8BMn2q1XN4Z4i0RSXF9TGlirWXJxr1x+k8ddyq8jXMbHz1gO1XNXKtszSgre9zgi4yMdauJ64abioy9TK3cxXxcnPM7X50j+nwNUgntfX
HZsu2dedzNl+o7zZZKkA2Q+uj9f1sEzVJ7Lx0fKy58yWs7bE8rM4tAK0mtPt0njUPM6M1sW+xtihr6XaUKXy2wKgmtz0n5zcUqP5252nqdoWq5vY4ayl1Qqud9HxrmvLuK8BwhSw
XLAmsCXbmtq/26nWI92fyI/eSrin34isQeBjpUrgv6K7362jjN4XpqzcAKgB2kSpVtZ1qlDRiatCymCsqr/FrA+t2Kwv4sHhkuJ/3mvjaNIw5FnBouT9s6PkFasg5CCmDeODpFvh
sKTx3iSlq9s4pk3Xeqdx0bSoZcmgqbG9CKpRqhuqpehP6N7op+VK6YzbjOnZynjp5rv56Bmx/uf1qXbmt6VM5EmjYeH1oojdyaN72BWl0NFyptDIbacXvNenIajrp33uO+6X7hns
su7R45DusdQT7l7ELO2Ft8zrBa7f6dimSufQoujjhaGF3+2h09lJo2PSvKR/yLul3roypnumR6a484bzu/PS8ZvzIest82LeYfJizSjxV75178yxMu3IqD/qW6Nz5uygkeHXoEjb
IKIj04ujcciVpAO6EKVYpSSlWvg1+E342vYB+HjxXffy5lT2stbc9PLE5vJntlvwxKsZ7d6k8OhaoaDju6DR3JuhDdTjoqXI46OJuWKksKR+pG38UfxT/Dn76PvC9hn7o+3e+cre
MfiRzAT2Srw/89GvvO9ip0jrH6Og5buhZd7poR7VxqIhyaKjc7kqpHikSKT5/9L/xv9t/h7/mPkP/mLxmvyJ5br6UdZg+O/DcvX/s8bxcqsp7aamUedDpN/fQKNS1lGj+8npo+C5
RKSlpHWkWuD8Beb43gmU/fUhu/6lQjH/eWVs/5GGj//so6X/1Lyz/y3Rvv8s4cb/O+3N/8b10v9V+9b/Z/7Z/6X/2f/Z/7WdQkdK0VUTq+r4I3nzH0OJ909lvvkHhhX7IKP2+9S7
kvz+zwP92d9Z/cbrnP0x9NL9qfn9/av8G/7c/Q7+DP4BjB1yXrDoLqrRmSqz4QdFRupUZVbv/YSQ8mChvfSHuUj2Qs1q977cSPhb6PX4hPB/+cT16fmZ+Cv6sfnd+dj5tYgSfbOg
w06Qv481S9KSSJrd22XE5OODiOk5n9bslbY4767J/vCq2Fny0uNn86rrOvSR8Nb0N/Mn9TL0WfRQ9FmJpYLNmQ9m57PeQ5rG1E0M0xdnatv4gjLh7JxO5U+zT+igxY/q8tNG7Jje
mu385ZzumupP7wHtjO/d7f7t8O3Wi06HnJcFdRetllN2vqtU9MobacnTX4IV2q6apt7grwbiTsGP5PbOfOYH2fHn7N8D6S7kq+lT5q3pBecf5wznjY8qjEWYXn/QqbxiWrnaXD7F
AGz+zTGCZtScmB7Zfayg3Ou8Qd+/yTnhMNOt4p7ZquN+3SXkYN/B4+Lf+9/j3zyUlZHcmpOHK6k1cMG262Wrwbtv+cmMgi3Q05bL1D6pO9iZuMjalsSm3GDN9N1E07veu9bj3lDY
7t2i2MHYpNi/mZqX4J72joqq1Hs3tmlv+b9IdJbHe4NczWyVrtFCpuDUdLQz15G/1Niix9zZ9sxN2gXQ/tlL0U/Yb9GX0XXR/J80ngCkPpZ7rfOFX7fseOW/jHmsxgiF28t1lLrP
lKOM0o6whtTAus3VE8Jx1trGbdZxyYbVTcr10mfKmcpzytimV6UCqtadq7EQj+u5L4IxwXV/DcdBh4vL/5PczkmhM9HzrLrSLbaN07y8tdPrwB/TAsOB0X7D682nw97DtMM1ru6s
tLDnpda2l5eYvQ+LpcPQhY3IGopJzBGU+c5pn8LQsKnD0d+xDtKot6PRMrtj0Ki88s3/vDrJPb15vUu99bXdtOi3da7AvO+fKcKLkwzHgYz/ypON8s2rlPbP9p0k0camkNHerULR
0LIx0KK1Ms59ttXK7LbkxDa3d7dGt/G9A710v0W3M8NrqGfHt5szy2GTOc6okWPQ35W20fWcQdI2pA7SJKob0S6uVM8BsIPMvbAmyESx68CfseSxsbEFxjzFKsciwPvJPLEgzbuj
7M9QmhHSOpZ206SXGdRlnP7T8KEl05qmhdGKqf3Oo6pLy3Sr3sUerE69f6zHrJKsC85izeHO5sjr0HS6I9PQqwrVQKFe1jSbCNf3mQDXTZxA1vefwdQro23SsKQcz7+lfsqnpvXD
cqcOut2nJqjvp93VUdV01m3R19cHxEbZMrRi2j6o+9p3oPjay5xM2p6c7dgwnsfWcp++00ign89WoQ/KaKJkwkqjKbe5owWkzaNe3ezcwd2Y2Zvesc1h3we90N9yr8Pf6aUk3wqg
4d1NnenbVJwi2dKbZtVqnHfQb53yyaueJcGgn5+0FqBkoCygc+QX5KzkR+EZ5fXWVuVaxjTlFLeY5JKrbuOAo6LhDZ4c3zyau9vamE/XEZmT0R+aG8p3mzDAfpxusvacRJ0MnQrr
weoj62noOuud3wnrHdBx6kG/XemJsbzn5aZ15VKebeLvmHvelZZo2VOW5tJnl4HK0ZiCv9SZl7BSmqKaapoY8d/wGfHw7u3wh+do8OfZce8GyPztu7f066apQ+kon8ble5hP4RSV
n9tWlGLUTZUdy56WGb+rlxuvK5h7mESYmfZt9oj21PQq9qHuY/XV4iL0G9Fb8ne9/+8QrfHs5aAO6c6YIeRplOXdPpP91dST6sv4lPW+8ZX8rXuWy5aUlo77bPtu+xf66fq99Or5
/Olq+N7YX/ZOxLrz07Ff8JGjJ+znmdjm6pQm4CaTrdcfk+jM3pMev7OUQK02lYqVU5X3/8j/t/8G/ub+/veU/cXtx/u933n5js2Y9l+4BvOPppfuYpwN6eqWF+JHlEjZZJMSzoqT
sb/ZkxGtbJSzlHyUU95lBkv4rAha/fUdm/4OPBz/hl1d/4B+g/+rnJv/4rar/6rMt/8K3sD/OuvH/7P0zf/U+tH/O/7V/5v/1f/V/6ibjku4zjwTDuk/IGbyojzA9mFdIvntfZb6
zpuK+8m1Nfxhy7H8k9wQ/aDpWv318pX9/PjF/VD85v2l/dz92v3viplzma1jMebOvydx3+Y+cOiEXc/t3HxD8fKZm/NMs0f1asiE9i3Zdvfl5TT45e7L+K/0QPnc94r5FPlF+UD5
2odlfUWeDFJdvA80Qc8XQ+faTF5k4tN7beewl/XqKLCF7YvEcO/E1OnwAOEQ8pHp9/IL76Lz/PH+8xbzQPM382aIY4KTl01okbDCQxXDMUmyz/BfVNgAe2DeUpW54qms7uUwwFno
rc816lLbpuuA47/smOiD7UHrzO007FXsSeygipSGY5UJdqypVVSfugtRHseBYh/QoHqm1giTcdsPqQXflLu74UzKzuNO1WHl5dyK5qDhQucC5E3nxeTg5M/k9432iuGVZn9HpqNj
QrUuWgXBDWbbyb56cdAAkVzVgaUP2eq229u+xPfdCM+G3x/Wl+Bj2hzhe9y94A3dI90N3TGS2I8tmNOGc6WvcGyyAWQfvYNqccV+e8XLVI+O0CqiKdRVstzWN7/Z2MHIPdpCzxHb
GtM829fURdoy1U/VNNUwl0qVzpuHjY+moXujsextIrvEb7fC43yTyBWOBs0cn1zQ8q3P0tm5h9Sbwp3VeMgR1tfLvNVEzQPUZs2LzWzN3pxMm3ygL5QyqQaFibKDd8q6rHWBwfB+
vsZcjbbKbpykzd2ptM+xtAnRpLyx0d7BpdG6xKzQrcUJzsXF9MXRxSqj1aEEpiibDa1xjdO0lYDYuwl8ocGqgSbGKY2JyS6a88sgpofN0q9dzue2fc55u9LNwL0VzD++Y8hqvqC+
eb7/qdqoQKyaouWxXJVCuBeJGL6mgu3CAIWsxo+NZslimDjLvKI7zEerfMxysfvLQbWXytO2+ccotxrDZLeft3S3RrFJsAyzjKqGty6dobwokVjBa4k7xeOILMiDjjPKDZdfy7yf
wMv/plvLMqwjyiev8McDsFbEb7AxvsCw/7DQsOW4C7hHutOyxL0xpcDB6JhrxTOQYsg+jYbKDpDTyzaWUMwVnQPM/qLpyh2n68jqqNTFl6kowSKqqLmCqsaqlaq/wAPAzsFKu3TE
k61zx5CgJ8r2lj7M95GXzRuSKc7OlfPNwprxzCyfF8v2oUXI4aI5xJ6jaL5KpIC1t6T9pMmktsgVyIDJ2MNuy2u2js1YqGPPq52o0PKWPtGelBnR0ZUu0KyYc85fm9LLcpwhyD+d
E8MYng+86Z62sVyfpp9wn6vQItA70VrMjdKtv+zTdbD41GukfNUVnFzVepeF1C6W6dK2lnTQGZcHzViXcMgXmFfCE5kWuv2ZSK53msSajJp/2AvY3ti21K7ZJclo2gm5xNpfq5ra
TKHQ2ZGaUdivlgnWepTd0tCSpM60kiPJbZP3wZKUdbiLlTWrB5ZWlh2WFuC2307gzdyy4HDS3+AlwqTgurLg36OmfN6nnWLc+pZ22bSRl9Uhj5XQk44qykmP68GJkCW3i5F5qAyS
XZIjklrnC+dx54bkfede2zfnwMt75pm6MuUgrEXjaqCc4FqWGN2Sj47YC4zI0gOLdsu3iybC+owgtv+NE6aEjtaOm4437vftNO7P6/nty+NV7YLVLuwCw3PqqLEO6A2i5eQHltTg
D46s25eJK9UiiPzMtoijwueJZbXnigSka4u/i4OLoPRs9Ij0lvIW9JjrJfOj3qXxpMuI70m2uuwcpCHpapaS5BmN2d7Oh67XD4avzlWGWsNPh/O0PIhMosCIFInYiIz6ZPpl+s34
w/mA8o74F+a+9qzSSvTsuyHxbacm7YSXLOisjPjh9oY52tCEhNCVhE7ENYXTtPmF9qB4htGGlYb1/7v/pv+M/aT+IPYG/QHq1Poy2Qn49MOS9DysT/DEmA/rYo2P5E6HddxshE3S
e4N6xc+DKrUchDKgqITyhLWEVNzfBq33wAce/bgaev6HNgb/flZN/xJ3dv/DlZH/DLGj/yjIsP/U2rn/L+nB/37zx/89+sz/C/7Q/5H/0f/R/8yZj088zHYTdOdMHVHxNTf09V9W
g/h4dhT615Qc+9yv1fvBxlz8PNnD/G3nFP2Y8Vb9O/iK/fT7r/1q/af9pf3+id90CqsjND7MuCU73dc5nualVkjsZnXy79ySdPIxrUD0isOW9ZHVnPZc42v3M+0P+I7zj/gS9+H4
bfij+J74HoerfRacP1VguWUzWMyoPkXYvlcK4G10U+V+kA/p1KnJ62C/1+3D0G3vBN6s8HjnpfFy7WDyrvDG8ujxFPIM8pWHKYKclVtqg61gRMW/qkV7zMlZUdXBc5XbF44i4CKm
heO1uhjmUcsU6OvXn+nP4M7qeeah62Lp9ett6pDqhOqXifSFc5PwdpimmlUPt4FOesP8XJXMonNG08+LP9hdov7bzLXa3oDFDOFj0briv9n14+Heu+SK4c3kX+J64mrinIzsidCT
b38go9FkgbGHWA29MGHkxRx0k8zciaHRsZ551dqwZtiVv57arcpD3GHSYt0c1+/dYdmS3QTaGdoE2nCQWY7blSmGJqJTcXqu8mLguF1mHsFIdXzHUYhdzEWbE9AJrOHSrLny1PfD
ZdYAy0DXNs9q1yjRbtaG0aHRiNH6lEuTJZlHjAqjkXt7rRxtorZMbBS+K3ftw0uHbcgymNXLdKdYzvizHdBcvTjRt8Op0WTHSdHryILPFck6yR3JKprEmGudX5JlpUKEJa6edgq2
uHKWvMF5xsHdhsHFjpW2yDejzsqBriXM+7bHzJu8rMy3v5zLv8DhyNbAAsHhwPKfw56DosmY76gIjC6wYH/btml5drz4fOfA/YZDxGWTq8ZanzzIX6kIydywFcm3tU7IMLhtxrO4
msLauA+56rhGpkClTaiqn3KtY5Ncs3eH4rgngIm9t4AvwbyH28O6kaHF55uVxpSkwMYIqx3GD6+PxKSwv8H4sLW8N7FxsUixFK0xrK6uCKfEsrOagLcUj/G74Iaov+6EfcIPiW7E
mZCFxdyYysUYoEDFZ6Xaw2+obME2qZC9n6k0t/OpMqoGqk60hrOOtcquvrhAonC8aZbhv3uNrsJ7ibLE5orjxfCPQMY3lsvF4pt9xO+fP8Keod2+LqLeubeiGrIYo1ujK6Pduy67
1LzWtkG/NqoGwrSdi8T/k3vGQo6xxzONHsi/j7zH5JODxtqXZcRVmkHB8ZrYvI2bo7Y5nGatqJzunLycrMMTw2XEGL8rxqeyIMgtpc3JdJrsyjCTW8vVjwbL5Y/jycyR4cfDk+nE
O5TTwKmUU7tmldezMpYUqaWW8Ja7lqPLHssnzH3HXs2Ru5zOAq2Fz/eg4s8smJLPs5KBzkOQncyzj8/JCY/4xX2O5sDajkS6sY90sZaQI6USkWCRKJGo0zXTANTrz7zUy8Rb1VW1
lNWzpz7VK5081JyVddKlkNPPI405zCyKgMc0iWzBf4mfuXaKcq9ri4+h7Is9jAOMo9tA29XbStgp3AnOPdwyvtvbza7j2jWiOtlYmMfWgpBu06qJC8/RhXDJZYRYwpyEW7m0hcut
r4ZVnjKHhodKh3vjJ+ON44PgieMj1ybjlsc94le2tOBDp3LegJpd2++OVterhjHS9oG3yxWAm8NOgG25ZIF3rF+CcZvjgjeD+oIa69TqEut76MTq+N/86T3RnehVvpLmGKzH4wCb
HuBxjXPbHYSV1Zd+RM5cfCrFiHzOuYN9dat0fuOY9n5OfxB/bvI08lHyH/DE8WLopfBw2t7uXMZh7HSvGembm+nkZoyo3+CBH9myewXRX3n6xkt5eboWesWq7nqrlm17yHuIe2f5
N/k3+Vj3cvgQ8AH38uHY9ErM8PGJszfuOZ2P6dCLzOPpf67ciHnj0wR3/8iZdnC7GXdvqs9305RDeKB4X3jz/6v/kv///Ff++vNi/G7lvvnY0Wj2VrpN8nKgTO0VizHnvH6130J4
e9ZFdQbLcnSyvIZ0oKoXdZOTaXXSdY91XNpnBwz3DQfh/BwYWP7WMfD+WFA9/1Fwav9Aj4b/ZKua/6/DqP+Z17P/F+e7/1Tywv+p+cf/3P3M/4b/zP/M/x2YRFPVyfUT3OX9Gjrw
oTIn9T9Q4fezb4/5Q46r+h2qcvsnwgX83dV0/C/lzPw/8BP9d/dM/ZH7df0s/W/9bv0rifh1rKgUN7DJWiQQ26s10OSrUMDqn26f7jOMSfFDpzTzr76i9ObRvPW/4Jr2betM92Xy
1vc79jH4vff49/T3eobnfR+aTViTtmIzjckyO7XVDVK63bltPOO8iSfns6MJ6ju6N+y2zOjt9to87zDlR/DK6xDxTu+B8anw2PDQ8OKG94HfkzZstaqKRae8FkNmyZ1UY9I+bdXY
S4eP3dKfGeFAtc7j2Mbn5WXUiucL3svoKeSt6WjnCeqO6LLop+iyiGiFwJG+d8+jN1fCs+JMCcBoWC3JaW36zxOFFtXmm/fYCrDy26XAPt5hzQHgZdZN4QvcHOLs3jTi2N/y3+Pf
cIsFiQKSd39OoCdmEK6uV1a5Ul0bwklu1Mg7g/fNH5jn0diq7NRQujnXMMbt2H7OFtqc06baH9ZH2tLW5NbR1uyODI3Xk5WFNp8KcuOqimLutDhjBL3tb1vD5oFDyK2UB8zOpeLO
EbT/0P++eNKUxlTTIct40z/NctKozcHNqc0Qk46R05Ysi+ufmXu3qcpsd7K4abO5VHJ1vyeB8MOdkVnHDKHgyQmupsv8t73Mxr4jzb7CssxmxNjKjMSxxJXEz5ePlryaxpAGop+D
K6oVdqaxinDzt211Ab0EgevADo/Xw7Cc58VMqDPHLbHFxyq3ksd/umXGkLuOw6m71Lu0uyCdEZxtn6+WRKXNivercn4+sml3lbcVedy7goEdvwyNccHEmO7C7KKjw7Cqk8PKr6fC
Y7KbwOCyorwLsz+zG7P7ohCizKQKnXWpoJHkrhaGCrQtfm24MX3ku52Cbb6WixbATJXqwOyd8cB8pCPAoKhivkeqWbuLqh62yaoCq9uqVqmIqMSq4aN0rniYyLJCjeO2vYRYupyB
+rxGhMK+qIqxv0iSy79JmRC/iZ5wvZOhwLo6op22laIGsOuiKKP+oiawca9FsSKrJLSTn363L5Sjuh+LM71DhgK/YYYCwDiKLsCwj4K/7pT0vb2Ybrsymrm3mZpmshGbW6p2m7ib
iptft762PLi+smq6HKfpvB+bK79dkeHABovgwdyIFsI6innBbY38v7+QkL3EkhO67JJHtWCTrq76kx2lbJSzlIKU875lvpm/rLovwSev68JHol7EkZdGxdSPe8WTi+jEgYp9w1uL
KcFyjNO9I4xTuRiMX7ObjG6rXo1JoNKNHI7ojdPGU8ZJx9/CW8i0t2vJ06khytydRsqplLjJa45fyOiKJ8YriffCW4exvtqFIrmthfmxTIahqCiH25uih/KHu4frznvOOc9Hy9nP
psBQ0OGxWtBfpMrPd5mBziqRZ8wii2LJSoZVxfGBGcACgHS5tn8LsXyAQKZfgdCX4IEygviBK9fI1lXX0NOR18bJgdd7uu7WOKu21T2evdOWk+jQjYoazSeCMcjvfP3Bk3o8uj96
jLAYe0WkBnwklIR82nydfHzfJd+I32ncbt/10uXeosPF3XSy8tvlolLZIpXL1QuIO9FJfnnLXXhPxJp1cbtMdXSwJnaqog131JCOd+V3pnfM54Hnvuf/5FjnGdxk5hnNxOT8uWLi
BKco33+U+Npfha7Vs3oazxp0/8YpcQe923C8sKBxbKF6ct6N93JQcw9zCPDH7+Lvd+057w7l5O0/1s7rR8Ho6PioHOWMk0/g6oJX2jh3/tIwcP3JUW31vuJsY7GAbY2gRG5Ci7tu
Fm/Ubhv45Pfi97z19/Zw7UH1qt228tPFTu84q/rqTZOd5ZmACd/FcwHX0Wwzzf9pMsFdaWyyxWkYoGpqC4nYajRr72rw/5j/e/9a/P/9h/Gn+0rgg/jOyZL0qa/F70CU+um4ffzi
4nCE2hpqM9AlZ4jDSmbZs0tmQaDCZnSHRmejZ1xnbtj7B2n2gQaj/PkVNf7sLdn+90os/zRqXP8wiXv/+qWR/0a/oP9g1Kz/7uS1/w7xvP8V+cL/o/3H/3v/yP/I/5SWrFaFx6kU
SOQpGSPv0y5X9OVKPfeQaQf5Iog3+pmkDfuivar7ftIj/NrigvzQ7s78tPYM/SL7OP3s/DT9M/1wiOp2e6YfOjzHgyPy2EgyB+N+SzrphmhL7fGFG/COoSPy6bmp8zDO1vQV3sT1
pumC9jjxF/dc9Xn3BvdF90H364UafliYK1vzs+oz4cZ8ODjTNk1127VnKeF1gz/ly51F6Cm1kuqgyFvs19fD7dri4O4C6rXv3u0v8Frvje+G70WGy4FTkuJtIagcR7m5TkFzxk5Q
jM90ZyPW+oAC27yZrt7fr4DhXMKz48fQauUw27zm0OGq51rlDeiX5r/mtObsh++EQpB1eEmhA1mzsABMyLy1VOnF7mfHzNd++9GvlfbVYqoI2b+7attEyT3d9dKV3gjZbN8s3IXf
M91O3T/da4o8iG6QfH/GnY5n6Kp8V921WFqDvkFpN8UpfWTK25Fizu+kddEJtc7TmMGL1X3KudYG0EjXvNLj1n3TjdN705qN6osTkhSFmZzJcp+nomJEsd9gJrlma2W/FXxHxGyO
DMi1n+rKca4JzfC5gc4GwlfP7cZwzy/JW86eybjJoslkkQmQy5QziiWdqntOps1sn67jZ5a1UW4yu6R7l791i/XC0JpzxRyoLsd3sjjIqrmNyPC9BMiyvxDG2b/7v+G/v5WglGKY
XI8HnxKDk6bLdZyt/26bs+Jxd7jee0C8BIkTv2OWDcEeokLCSau6wpGxaMIWtRbBN7Ybvku2drZYtqWasZm1nNGUAKK1iSaovn39re91A7PudQ+3unwlui+HVbx0krC9jpxCvnGk
Cr65qfC8cqyyuuSsjLYPrUCtHq0RoD6fsKGymuKlDZDVqu2Ekq+XfKKzSXrZtih+Lrn0ham6BI9Pu2aXJrvznSK6IaIluL6j3bTyo2uvMKRnpEKk/qVEpUSnDKGQqnOWd66jizGy
8oJVtdl+tbcdgEK5QIX5uRKM27mmkuK4uJf+tqKaBLQbm5WvaZu9qLub95vOm2aswatkrdKn8a8kne6yLpK8tQ6J/rd8g4i5cIJIug2FM7qSiUO5NY5rt6WRk7TEkoaw6JLZqk+T
haK1k/aTyZNEs7CyB7QAr/G1Q6QiuMWYFroGj4K7Log7vAuFK7w2hUS7aYd4ue+JtLZXi9ey9YqlrSSLpaawi8KcIIxljDWMkboLuiK7lLaCvOer/L2dnym/+JTKv96Mt7/Lh9i+
oIUavV6Fa7qAhbC2QITBsZ6DWavWg/SihIRxl/uERoUShUXCzcGrwoe+ksMVtGrE36bhxAubwcSFkejDkoo7wgmGpb8kgw28DoBTt319RrGwfJmpCX3An859j5JGfpV+X35XyuvJ
mMrSxhXLuLxby6KuKctUoVTKIZa6yCiNQ8YYhtTC9H9QviB6kLgnd1yxOnZeqLN2Ap2FdxmOAHhReBh4vtJc0t7Sa8/80qzFvtL4tvDR7Kdu0KiaHM5Fj97KHYWYxiB7JsGJdFy6
K3H6sUBwoqfScLiapnELiiJydnI5cm3bFNtw20rYOdvhzoPa3b8j2dqu/tbrnvnTRpD5z66B38pqdoHEQW+rvKBrGLPKal6nZGvcmC1sYYambP1svmxX5AjkQeRi4b3jO9iX4h3J
ruDste7dXKI92nGOgdXPfZfPznFRyDdqdL+NZq60z2WQp1ZmbZcVZxqDiWfkZ6Nnce0p7ULto+p27KTh5eog0nnocLwh5dWiyuDri1rb9Hmp1C5thcxeZanCAGK4tkJhN6iwYW+W
WmI2gMhiJWPgYqr2a/Zl9vTzTvWn6kzzQNlV8FG/Y+wHo2rnvIlO4fR16NlhaPrQ/GA2xtxdMbkaXVypY13xlfhdwn1bXrlecl7t/3//YP+d+5v9w+7T+gfbH/eEwYXyOaX47M+H
V+YqcXLe7GMC1RddqMkZWuS7KlkMq1VZM5b6WQV8SVqfWlVaiNacCMP1HQZj/EEUEv6dKsH+TkYb/75kT/+Vg3D/z6CH//+6mP8k0aT/w+Ku/8jvtv+D+L3/Z/3C/27/w//D/y2V
zFlJxZEVtuLAFwvupSuG80VGl/YUZH74dYLC+Vefpvo1uU77Hc/P+4XgNfxZ7Yf86fXJ/LL6+vyn/Pf89vzLh753cqQ3PeDEGSPf1okvQ+EKR7XnD2P36zGA7O4fnBDxPbWt8n3K
7PNa2+n0yOe09ervUvZ19Lz2R/aK9of2bYVIfruW0118sdg0UsR7Ns3QI0k62WRiHN+hfVrjKZiB5iuw6eiLxMnqsNRE7HbgcO0u6FHuYuzT7v7tNe4u7r2FpYHykF1vwaX3SPa2
L0Chw7ZMzMxaYoDTN3t+2PiTR9ycqjLf3r164R7NQ+M02KPkXt+a5TnjAuaN5LjkreQ+h4WE744Wef6e7VrbrcVLtrnVUcnCMWOuySV58s7Uj//S36Qj1tm2k9gWxXPaZs/T2/rV
rdxa2cXcdtqR2oPaiImMhwqPhn+Am/JoAqjEV56yIVgau/Zkv8Gyd+rG+4vtyjCfB87Jr2XQ67wl0lnGUtNIzNvTN89r0wvQGdAI0HKM64qFkJ6EQ5qLc6WkEGPgrTtfgrWfZ5+7
5XZuwJGIKcTRmQHH36gZydK0iMpbvVHLksJZywTFL8p5xZDFe8Xtj7OOApNXiayav3s3oxZtE6uhZr2xCmsmt8t2aru7ha++1JQZwUSiwcLwrLXDf7Tvw/q4SMPeujXBBLsluwy7
75Prkk+WHI5cnJSCU6Oydeap7G2OrwhvK7Rhd8a3e4N0umGQTbwRnGC9Z6W0veyrOr2Ur7y7wbCXuM2w+LDbsHWYmZdNmiiTFZ/BiLSkLn0Xqth0wa5oc4eymnhktd+BY7d3jJC4
VZbzuD6eiLifozm3ZKbBtMymZrDwpiKnAad7nb2c7J6YmK+ipI4np+mDdatWeymv63cUslt6KbTigGe1IYnUtRSRb7V5lyy0nZvrsSWdW64/nayoeZ2ynY6dAKNYoiGkgZ4Op6CU
iKo2itytcIGlsId8trKAfPuzb4ButEeGC7RFjMqyA5GZsLuTTa32k4yoJZRvoXeUtJSMlASpbKjjqdKkIKzumr6uX5AtsUCHGLMggVK0+37EtG+AY7TngyOzz4f4sLmKxq1mi1up
PItQo4eLsJrsiyyMAIyFr/6uLrCaq9axpaGzs6CWUrXqjGq2q4XRtq2BcLbBgDW124EQs3yD7K8ohKmrIoMNpvmCpp5qg2+U14MchO6Dg7YItv+2yrInuOSoWbkpnTm6opKJujKK
I7pqhO64PIHUttt/wrP3fpyvq3w7qlN7XaM2e4eaynurjjx8hXxTfP69jb1Tvni6C7+zsKS/IKTTv3qYZb+ujje+FocuvJ2BM7mSfS61MHn9r3l1cqn6c0Sh93PwlqF0YIkXdWR1
L3X2xY7FKcaQwn7GBLmLxpqrFcaEnvHEFpP+woCJJMCDgUa8HHpJt8FyBbGubkapFm28nzxt25PubYyEZm61bn1uac4Lzn7OK8t5zrrBB86os/XM4aQhy2iXb8hgi8PEG4ABwI90
CLqkbKyyP2iyqbdmwZ74ZkeRrGcqgB9odGg4aFrXAddS1y/U+9bgyhDWQ7xp1ISr69FQm3vO3IsAysB7WsQLb2S9sGbstDZisKrWYE+eJmExj9VhOHxEYptiXGLG4HLgpeC33QDg
Z9Sg3kHFadwlskLZFJ4W1d2Izc+2dkTJfGlSwe5gv7eaXD+sbltpnr5bmo1gXLV4zFwlXeNcrupj6nXqp+eD6S7er+cQzuTk1rcT4QWdLNy0hBXWfHGuzshjx8VIWx67eFdfrnBW
Ep+1VoiMTVemdbBXDFjGVxP1y/TA9AnyefPH5yLxvtS07dm4LukBm4fjjYCp3Olrb9TFXaXKEVb9vrdSErHYUVqgDVITjI9SFnPtUkpTAVPq/2j/Qv/D+in9rOvk+eDUkfW/uD3w
cJrg6WB8YeJAZZHZGFgwz0FR4cJcTii0m01ZorNNh4wzTllxdk7bTo5O
"""
TABLE: Final[U32] = np.frombuffer(base64.b64decode("".join(_CODE.split())), "<u4").astype(np.uint32)
"""uint32[ROUGHNESSES · COSINES · INDICES]: by roughness, in it by the root of the cosine, in it by that of (ior - 1) / (ior + 1), each
from 0 to 1. 65535 E from without, and from within in the upper half."""


def kept(roughness: F64 | float, cosine: F64 | float, ior: F64 | float, *, within: bool) -> F64:
    """E, f64[...], of these roughnesses, cosines and indices, broadcast together; read from the table, linear between its nodes."""
    index = np.maximum(np.asarray(ior, np.float64), 1.0)
    places = (
        (np.clip(np.maximum(roughness, ALPHA_MIN**0.5), 0.0, 1.0), ROUGHNESSES),
        (np.sqrt(np.clip(cosine, 0.0, 1.0)), COSINES),
        (np.sqrt((index - 1.0) / (index + 1.0)), INDICES),
    )
    both = TABLE.reshape(ROUGHNESSES, COSINES, INDICES)
    shares = (both >> np.uint32(16) if within else both & np.uint32(0xFFFF)) / 65535.0
    lows, parts = [], []
    for place, count in places:
        at = np.asarray(place, np.float64) * (count - 1)
        lows.append(np.minimum(np.floor(at), count - 2).astype(np.int64))
        parts.append(at - lows[-1])
    found: F64 = np.zeros(np.broadcast_shapes(*(part.shape for part in parts)))
    for corner in np.ndindex(2, 2, 2):
        weight: F64 = np.ones(())
        for part, upper in zip(parts, corner, strict=True):
            weight = weight * (part if upper else 1.0 - part)
        found = found + weight * shares[tuple(low + upper for low, upper in zip(lows, corner, strict=True))]
    return found
