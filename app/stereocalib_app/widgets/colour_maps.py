"""Perceptually even colour maps as numbers: cividis, inferno and viridis of matplotlib (CC0), 256 colours each.

They stand here because to load them with their library takes a quarter of a second at every start.
"""

from __future__ import annotations

import base64
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_TABLES = {
    "cividis": (
        "03uBQBToP$Pyi%S03}oaCRG3?R{$qj04Q4kC|m$3UH~d!04ibtD`WsHW&kW_04-?%E^7cUZ2&KC05EU>FmM1dZ~!rI1Tt_4G"
        "jIzta1JzZ5jAfVHg6U-Zx}ak8aQtpIBp#|ZXY^sAv<m&J8mRAZY4c!Cp~Q_K5Z&LZ7V-*EI@58L2NHVY%oG>F+*%JL~JxfY&"
        "At}Hb!hWMr=4oY&l45I!J3fNozeyYd%YBKTB&sOlv_+YeG$HLr!Z%PisX_YerCOM^S4?QEN$3Yf4jVOH^!3RBTOEY))2ePF8"
        "GBS8PyNY*AQjQdw+MT5MEWY*kxrR$OgYU2RxhZCPGzSzm2hUu|1pZd_q*U14rsVs2k!ZeV0?VPtP%Wp83;Z)0X}WM^+>XmDm"
        "}aA#?7Xlih1YjJ67acXRFYi)6CZE|gHa&B*OZg6vNaC2~Rb8&KWa&vTZb98icb#!%gb#--ic6N7nc6fMpd3bkud3SnxcYAwx"
        "e0z9(e0Y9+cz=C(fPQ#^e|Um`c!Pj=gn@X4f_R04c!q;`hlF^Dg?NdEc#4L2i-&lOh<J^Oc#es9kBWDYi+7QXcan^ElZ|(jj"
        "(3%hcb1QLmymXtk#?DqcAArRo0E2&ly;q!b)J@WpO$r?mvy0-bfTGbqndQ2nslX`bEcegr=4@Co^z?5a;l$ltDthMp>eIEaj"
        "v3qucL6Vq;RpNaI&Uvv!-vfr*E~WZnmjzx2kQpt8KZfZMv*%yRB@zu4}!oYre2*zp!e-v1!7xX~VN<#I$I|wP(h)XUDc?$hT"
        "$5xMj+@WXrl_%)4XFykgG0V$Z!{(7s^OzhKkAU(~@~)xuuZ!(G?IT-d~0*~MDg##-CQS=`82-pN<r%2wdZRpHE3;>=Uy%~Is"
        "fQRUB2=Fm^*(N5{oP3qH3>(oo^)k^KwNbc81@7PB1*+lZ%L-X1~^xHu7+&}i+J^0=``QJMF;5hr?HvQr>{o^zJ<uv`~HvQ)}"
    ),
    "inferno": (
        "0009300aO41_1yE0RagC0Sf{F4gvxY0|F8R0~7=U76k+t1_T=i1sw<m9|;B_3I`(#2PO>&C=LiJ4+$+02`>@~G7}0k6bm*M3"
        "pp1HI~fZ;8Vf)i3_~3ZMIQ`DAPh<(3rr*nP9_UbCks+33sfr#RxJuxE(%&O3S2S?T{H<_H3?uh31K-2Vmk?BJPBn!31&bEW<"
        "d#OLkeg`3TZ|PX-ErdN(*XB3~NmcYflYqPz`KS4s25nZB-9#R}XDi5N%o!ZCep;T@r3z5^i7<ZekQ}V-#*>6>eq~ZfF*6Y8P"
        "&67jA7BZf+QEa2alL8EtbKZFL)Mb{lPY9Bq0WZF?PTeI0Cm9&CUgYk?nYgCJ{#AZmsoYKS3fi6Uu>B592yX^tdlkR)i4C1;Z"
        "*XO$*qmL_JHCuNx^WSb~toGD|TDPy22VxcQxqbp&gEMTTAU#Bf!sV-itE?ulIT&^%%uQ6M(F<P=RS+p})wKG?@G*-AZR=PG-"
        "yEjz5H&ebiQolJ-!8%aFJ5R(sPQ^V<$39HRK1<0zO3Oe=%t1)aLPyU;M$kn>(MChkM?%y{LDfk>)=EFuOFr36J=#t?+fO>&P"
        "&wUFINnn?-&8i>Ry5*QGvin?<XSQ1TQKHaF6Le>=U*)7VJqokD(Yk?>t!eGXD01vCGBb>?rb9OZ6WY)AMkJ<@p2vVbR6<^8u"
        "ND<^LZHbdKUG374?1;_J9)hff4tE5ch=+_=gSnhz$6O3;B!*`Hl$rkO=yb2l|r+`jrOymj?Tp2K$=^`<({+o(KD&2m7K3`=k"
        "o{rVIP14g0DN`>YWAt`hsO6#KCj`?DDPwHo`k9Q(N*`nw_ey(9X+CHlcA`NJyt#Vq;9FZjtZ_{%i-%{TYYI``2$_R~N1)k5{"
        "xMfKT8^xI4H+)wk~QuE+e^Ws_Z<X!USVDac=@#$#s>umAuaPjVR@$h-^@_q92f%5c)^Y)4K_l@=Vk@otP_xqXo{GIy!p#1)%"
    ),
    "viridis": (
        "L;+Mp0#!r<S49O_MFv_$2wO%8Tt*9CMhss@4q-<RVn-2UM-pX66lO;iXGa!kM;K~I8EZ%yY)Bk#NF8rT9&kt?aY!L@NFsAcB"
        "Xmb4bw?(4M<;hjD0oLIc}FXHM=X0rEqq2Vd`2*RMlpUxGJi!he?>KbMK*y%H-SVsf<rokLpy^*JcL3$ghD=rLO_K<L54v>hC"
        "oAyKtzW>MTb8}h(1V&K1qo^N{Ky7i9Jk-JWYx`PKrBFiaSw?I#P=|Q;RuNi#b(`I97`|SBy7Uj5k?~Hd>4}TZ}baj5S@1G+v"
        "D~UyU<hjWc15GGdJ~V~sInjWK17F=mZ0XN@pujW219FKUf0YmP2#jxKGEEpCo2Z;mW*jx2GGEOL%3bB-%?jw*GIDt3-4caAA"
        "|jwyMLD0+@4dX6Z2jwgJMCw-15evT%8jwXPPCV`G6f{rDFjU<GPB!!J6hK(bKjU$MSBZ-Y7iH#zPjUtPUA&iY7jf^3Vj3AGU"
        "Adrk8k&GXbj31MWAC!w9m5U#iiyoJX9+-+AnTj5niXNJY9-E0CoQWQth#sDZ9-oLFpobr!haaMbAESmKq=g`*g(0SeA*X~Qr"
        "-UP@gCnVeB&vcXtAQr0fhVniD6W4guYW4Aek-wkEU|qqvV1SIdoZ+mGPQa$ws|$Tcs96qIJtH?xpq6cbv?UuKD={4y>ddnaY"
        "VjwMZa%Hz-~#wZA-#zO~PwW!)Z~(Xj8>!RmNsl#${Q@WLwB$Uddr#$zWp2Uu4T&XUtq_%v)>CS#8c(aL!h8&sB8LRCmx)dC^"
        "gP(ocTUPJz=*gVRff)JcfdM~l@)jn+hv)<crlL6z4(m)Jg<*gT!tI-l7%qS`m5+BK)!GpgG%t=urL+%B@+EVbP$x7{ha-Y31"
        "@Ccob#!rvmr-yz4~AIjh!&EOr+;T+Q88`R+%*Wwx4;uzfG7~kU<;o}(O;~3}U8R_I1?Bp8m<s0$k9P{NK_U0e><{|p#BK_wi"
    ),
}
"""Red, green and blue of each colour, dark to bright, in base 85."""


@lru_cache(maxsize=8)
def lookup_table(name: str) -> NDArray[np.uint8]:
    """(256, 3) RGB of a perceptually even colour map (cividis, inferno, viridis)."""
    return np.frombuffer(base64.b85decode(_TABLES[name]), np.uint8).reshape(256, 3)
