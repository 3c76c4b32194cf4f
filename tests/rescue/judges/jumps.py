import sys,math,bisect
cat={};lst=[]
for fn in sys.argv[1:]:
    order=[];L={}
    for l in open(fn):
        w=l.split(None,2)
        if not w: continue
        if w[0]=='Y' and w[1] not in order: order.append(w[1])
        if w[0] in 'EP' and len(w)>2: L.setdefault(w[1],[]).append(l)
    for i,k in enumerate(order,1):
        P=P0=None;base=(0,0);pend=None;e0=None;n=0;dr=None;off=None;R=False
        for l in L.get(k,[]):
            a=l.split()
            if a[0]=='P':
                P=tuple(map(float,a[2:7]));P0=P0 or P
            elif a[3]=='Log' and len(a)>4 and a[4] in 'DX':
                x,y=float(a[5]),float(a[6])
                h=float(a[7])
                if a[4]=='X' and off is None: off=(0,0);F=(P[1],P[2],P[3],x,y,h)
                if off is None: continue
                dx,dy=P[1]-F[0],P[2]-F[1];g=F[5]-F[2];c,s=math.cos(g),math.sin(g)
                tx,ty,th=F[3]+c*dx-s*dy,F[4]+s*dx+c*dy,P[3]+g
                if a[4]=='D': dr=(x-tx,y-ty)
                else:
                    n+=1
                    e=math.hypot(x-tx-off[0],y-ty-off[1]); b=math.hypot(dr[0]-off[0],dr[1]-off[1]) if dr else 0
                    he=math.degrees((h-th+math.pi)%(2*math.pi)-math.pi)
                    if e0 is not None and dr:
                        d=(dr[0]-off[0]-ev[0],dr[1]-off[1]-ev[1]); dd=math.hypot(*d)
                        lst.append((fn[-7:-4],i,n,P[0],e0,b,e,dd,he))
                    e0=e;ev=(x-tx-off[0],y-ty-off[1]);dr=None
N=len(lst)
def st(s):
    s=sorted(s);n=len(s);return ' '.join('%.2f'%s[int(n*f)] for f in(.1,.25,.5,.75,.9,.95,.99)) if n else '-'
print('searches',N,'err after',st([x[6] for x in lst]),'| drive adds',st([x[7] for x in lst]))
good=[x for x in lst if x[4]<.4]
print('from good (<.4):',len(good),'drive adds >.7',sum(x[7]>.7 for x in good),'after >.6',sum(x[6]>.6 for x in good),'of which drive>.7',sum(x[6]>.6 and x[7]>.7 for x in good),'drive<.4 (match wrong)',sum(x[6]>.6 and x[7]<.4 for x in good))
for lo,hi in((0,.2),(.2,.4),(.4,.6),(.6,.8),(.8,1.05),(1.05,1.5),(1.5,9)):
    g=[x for x in good if lo<=x[5]<hi]
    print('  before match %.2f-%.2f: %d, after <.4 %d, <.6 %d'%(lo,hi,len(g),sum(x[6]<.4 for x in g),sum(x[6]<.6 for x in g)))
bad=[x for x in lst if x[4]>=.8]
print('from bad (>.8)',len(bad),'to good (<.5)',sum(x[6]<.5 for x in bad))
for x in lst:
    if x[4]<.5 and x[6]>.7: print(x[0],x[1],'search',x[2],'t%.0f from %.2f drive adds %.2f before %.2f after %.2f head %.0f'%(x[3],x[4],x[7],x[5],x[6],x[8]))
